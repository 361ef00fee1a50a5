enum {
    WGA_MADE = 0,
    WGA_BAD_DEMAND = 1,
    WGA_REDUCED = 2
};

/* What is remembered: the command before. */
typedef struct {
    wga_real last_thrust[WGA_ROTORS];
    wga_real last_tilt[WGA_ARMS];
    wga_real last_made[6];
} wga_memory;

/* Thrusts [N] of the nominal rotors, tilts [rad] of the arms, each within its limits; the wrench that they make by the
 * model, which an integrator should be told of; the smallest distance of a rotor from its limits, as a share of half its
 * range (of its thrust where the arm tilts); status. */
typedef struct {
    wga_real thrust[WGA_ROTORS];
    wga_real tilt[WGA_ARMS];
    wga_real made[6];
    wga_real margin;
    int status;
} wga_command;