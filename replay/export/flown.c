/* Steps an exported compensation again from the records of a flight: `wrenchgap replay LOG --export FOLDER` compiles this
 * with the export and hands it records on standard input. To standard output go: the tolerances of wrenches and beta
 * (two doubles), a record of the state after wg_reset, then one for each that was read, with what the code puts out now and
 * the state that it leaves. */
#include "wrenchgap_record.h"

#include <stdio.h>

int main(void)
{
    static wg_memory memory; /* all zero, as C99 makes it: also what wg_reset does not set */
    static wg_input in;
    static wg_output out;
    unsigned char record[WG_RECORD_BYTES];
    const double tolerances[] = {WG_TOLERANCE, WG_TOLERANCE_OF_BETA};
    uint32_t number = 0;
    fwrite(tolerances, sizeof tolerances[0], 2, stdout);
    wg_reset(&memory);
    wg_record(&memory, &in, &out, number, record);
    fwrite(record, 1, sizeof record, stdout);
    while (fread(record, 1, sizeof record, stdin) == sizeof record) {
        if (!wg_recorded(record, &memory, &in, &out, &number))
            return 1;
        wg_step(&memory, &in, &out);
        wg_record(&memory, &in, &out, number, record);
        fwrite(record, 1, sizeof record, stdout);
    }
    return 0;
}
