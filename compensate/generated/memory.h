typedef struct {
    wg_real optimum[6];
    wg_real correction[6];
    wg_real known[6];
    wg_real sent[6];
    wg_real lag_in[6];
    wg_real lag_out[6];
    int stage;
    wg_real fresh;
    wg_real actuators[WG_SIZE(WG_ACTUATORS)];
#if WG_OBSERVER
    wg_real estimate[3];
    wg_real integral[3];
    wg_real asked[WG_ASKED][3];
    wg_real made[3];
    wg_real sent_before[3];
    wg_real momentum[3];
    wg_real found[3];
    int watching;
    int asking;
    int following;
#endif
} wg_memory;
