"""A flown export, proved from its records: what was changed on the way is found, what was not is proved."""

import json
import os
import shutil
import struct
import subprocess
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import Writer

import wrenchgap as wg
from tests.replay.exported_c import COMPILER, DT, OFFSET, STRICT, needs_compiler, process, with_effects
from wrenchgap.compensate import Settings
from wrenchgap.flight.errors import LogError, UsageError
from wrenchgap.replay.export import records

pytestmark = needs_compiler
PERIODS, HEAVY, BAD, LOST = 400, 57, 111, (200, 201)
FLIGHT = """
#include "wrenchgap_record.h"
#include <math.h>
#include <stdio.h>
int main(void)
{
    unsigned char record[WG_RECORD_BYTES];
    wg_memory memory;
    wg_input in = {0};
    wg_output out;
    wg_reset(&memory);
    in.quat_EB[0] = 1;
    in.voltage = 15;
    for (uint32_t k = 0; k < 400; k++) {
        const double t = 0.005 * k;
        in.wrench_desired[0] = (wg_real)sin(9 * t);
        in.wrench_desired[1] = (wg_real)cos(7 * t);
        in.wrench_desired[2] = (wg_real)(35 + 2 * sin(5 * t));
        in.wrench_desired[3] = (wg_real)(k == 57 ? 500.0 : 0.1);
        in.wrench_desired[5] = (wg_real)(k == 111 ? NAN : 0.0);
        in.omega_B[0] = (wg_real)(0.05 * sin(3 * t));
        in.time = (wg_real)t;
        /* walk */
        wg_step_recorded(&memory, &in, &out, k, record);
        if (k != 200 && k != 201)
            fwrite(record, 1, sizeof record, stdout);
    }
    return 0;
}
"""


PLAIN, SANITISED = ("-O0",), ("-O0", "-fsanitize=address,undefined")


@pytest.fixture(scope="module", autouse=True)
def compiled_once():
    """The same files are compiled by the same words once, however many flights of an export are proved."""
    kept, run = {}, records._run

    def run_or_copy(words, what, given=b""):
        if "-o" not in words:
            return run(words, what, given)
        program = Path(words[words.index("-o") + 1])
        said = tuple(word.replace(str(program.parent), "") for word in words)
        key = said, tuple((file.name, file.read_bytes()) for file in sorted(program.parent.iterdir()))
        if key in kept:
            program.write_bytes(kept[key])
            program.chmod(0o700)
            return b""
        done = run(words, what, given)
        kept[key] = program.read_bytes()
        return done

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(records, "_run", run_or_copy)
        yield


def flown(folder, precision="double", gp=None, model=None, wanted="0.1", walk="", build=PLAIN, **options):
    """An exported folder, and the records of a flight with it: another program, and another optimisation.

    `wanted` is the torque about x, `walk` what is done to the memory before every period.
    """
    settings = Settings(dt=DT, max_evaluations=12)
    wg.export_compensator(
        gp, model or with_effects(com_offset=OFFSET), folder, settings, precision=precision, **options
    )
    program, source = folder.parent / "flight", folder.parent / "flight.c"
    source.write_text(FLIGHT.replace(": 0.1)", f": {wanted})").replace("/* walk */", walk))
    sources = [source, folder / "wrenchgap_compensator.c", folder / "wrenchgap_record.c"]
    words = [COMPILER, *STRICT, *build, "-I", folder, "-o", program, *sources, "-lm"]
    subprocess.run([str(w) for w in words], check=True)
    return subprocess.run([str(program)], capture_output=True, check=True).stdout


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    place = tmp_path_factory.mktemp("flown")
    records = flown(place / "comp", build=SANITISED)
    (place / "flight.bin").write_bytes(records)
    return place


def resealed(data, place, change):
    """The record at `place` of `data` with its bytes changed and a checksum that is right."""
    length = struct.unpack_from("<I", data, place + 4)[0]
    record = bytearray(data[place : place + length])
    change(record)
    record[-4:] = struct.pack("<I", zlib.adler32(bytes(record[:-4])))
    return data[:place] + bytes(record) + data[place + length :]


def add(offset, value):
    def change(record):
        struct.pack_into("<d", record, offset, struct.unpack_from("<d", record, offset)[0] + value)

    return change


def test_every_period_is_proved_and_its_numbers_are_where_they_belong(flight):
    found = wg.prove_flown(flight / "flight.bin", flight / "comp")
    assert found.proved
    assert len(found) == PERIODS - len(LOST)
    assert found.lost == len(LOST)
    assert found.statuses == {"WG_OK": PERIODS - 4, "WG_BAD_INPUT": 1, "WG_UNREACHABLE": 1}
    assert found.flown["number"][found.flown["status"] == 4] == [HEAVY]
    assert found.flown["number"][found.flown["status"] == 1] == [BAD]
    ok = found.flown[found.flown["status"] == 0]
    lever = np.cross(OFFSET, ok["wrench_desired"][:, :3])  # a force at O has this torque about the centre of mass
    assert ok["correction"][:, 3:] == pytest.approx(lever, abs=1e-6)
    assert ok["time"] == pytest.approx(DT * ok["number"])
    assert found.begins.tolist()[:2] == [True, False]


CASES = {
    "single precision": {"precision": "float"},
    "observer": {"observer": 2.0, "observer_max": 0.3},
    "process, effects and observer that follows a lag": {"observer": 2.0, "observer_max": 0.3, "process": True},
}


@pytest.mark.parametrize("name", CASES)
def test_every_kind_of_export_is_proved(name, tmp_path):
    options = dict(CASES[name])
    effects = {"com_offset": OFFSET, "servo_lag": [0.06]}
    model = with_effects(**effects)
    desired = np.random.default_rng(1).normal(size=(50, 6)) * 0.2 + [0, 0, 35.0, 0, 0, 0]
    gp = process(desired, "physics", ("past",), effects=effects) if options.pop("process", False) else None
    (tmp_path / "flight.bin").write_bytes(flown(tmp_path / "comp", gp=gp, model=model, build=SANITISED, **options))
    found = wg.prove_flown(tmp_path / "flight.bin", tmp_path / "comp")
    assert found.proved, found
    assert found.precision == options.get("precision", "double")
    assert len(found) == PERIODS - len(LOST)


def test_an_output_at_the_end_of_the_numbers_is_found_and_nothing_overflows(flight, tmp_path):
    data = (flight / "flight.bin").read_bytes()
    length = struct.unpack_from("<I", data, 4)[0]
    (tmp_path / "huge.bin").write_bytes(resealed(data, 30 * length, add(28 + 8 * (27 + 4), 1e308)))
    with np.errstate(over="raise"):
        found = wg.prove_flown(tmp_path / "huge.bin", flight / "comp")
        assert found.state_apart == 0.0
    assert np.flatnonzero(~found.agrees).tolist() == [30]


def test_a_changed_output_is_found_with_its_period_and_quantity(flight, tmp_path):
    data = (flight / "flight.bin").read_bytes()
    length = struct.unpack_from("<I", data, 4)[0]
    torque_y = 28 + 8 * (27 + 4)
    (tmp_path / "changed.bin").write_bytes(resealed(data, 30 * length, add(torque_y, 1e-6)))
    found = wg.prove_flown(tmp_path / "changed.bin", flight / "comp")
    assert not found.proved
    (only,) = found.deviations(5)
    assert (only.number, only.quantity) == (30, "wrench_cmd[4]")
    assert only.flown - only.made == pytest.approx(1e-6, rel=1e-3)
    assert found.apart.max() == pytest.approx(1e-6, rel=1e-3)


def test_a_state_that_something_else_wrote_to_is_found(flight, tmp_path):
    """The optimum from which the next search starts, overwritten between two periods: the output may be right."""
    data = (flight / "flight.bin").read_bytes()
    length = struct.unpack_from("<I", data, 4)[0]
    state = 28 + 8 * (27 + 30) + 8
    (tmp_path / "changed.bin").write_bytes(resealed(data, 30 * length, add(state + 8 * 4, 1e-3)))
    found = wg.prove_flown(tmp_path / "changed.bin", flight / "comp")
    assert not found.proved
    assert found.flown["number"][~found.continues].tolist() == [30]
    assert "changed from outside before 1 of 398 periods" in str(found)


@pytest.mark.parametrize("count", ["same", "back"])
def test_numbers_that_do_not_go_up_prove_nothing(flight, tmp_path, count):
    """A state that is changed before every period was "proved" where no record follows another by its number."""
    data = (flight / "flight.bin").read_bytes()
    length = struct.unpack_from("<I", data, 4)[0]
    for k in range(0, len(data), length):
        number = 7 if count == "same" else len(data) - k
        data = resealed(data, k, lambda record, number=number: struct.pack_into("<I", record, 24, number))
    (tmp_path / "changed.bin").write_bytes(data)
    found = wg.prove_flown(tmp_path / "changed.bin", flight / "comp")
    assert not found.proved
    assert found.agrees.all()
    assert np.sum(~found.ordered) == PERIODS - len(LOST) - 3  # the first, and two after which all is forgotten
    assert "395 of 398 records repeat a number or go back" in str(found)


def test_two_topics_that_repeat_a_record_and_a_count_that_runs_over_are_proved(flight, tmp_path):
    data = (flight / "flight.bin").read_bytes()
    length = struct.unpack_from("<I", data, 4)[0]
    data = data[: 100 * length]
    for k in range(100):
        number = (k + 2**32 - 50) % 2**32
        data = resealed(data, k * length, lambda record, number=number: struct.pack_into("<I", record, 24, number))
    (tmp_path / "twice.bin").write_bytes(data + data)
    found = wg.prove_flown(tmp_path / "twice.bin", flight / "comp")
    assert found.proved
    assert (len(found), found.lost) == (100, 0)


def test_a_run_whose_parts_change_places_is_found_and_a_refused_period_is_no_start(flight, tmp_path):
    """Behind a demand out of reach the state is that of wg_reset, and everything could follow it."""
    data = (flight / "flight.bin").read_bytes()
    length = struct.unpack_from("<I", data, 4)[0]
    first, second, third = (
        slice(a * length, b * length) for a, b in ((0, HEAVY + 1), (HEAVY + 1, BAD + 1), (BAD + 1, 200))
    )
    (tmp_path / "swapped.bin").write_bytes(data[first] + data[third] + data[second])
    found = wg.prove_flown(tmp_path / "swapped.bin", flight / "comp")
    assert found.at_reset.sum() == 3
    assert found.begins.sum() == 1
    assert found.flown["number"][~found.ordered].tolist() == [HEAVY + 1]
    assert not found.proved
    (tmp_path / "whole.bin").write_bytes(data)
    assert wg.prove_flown(tmp_path / "whole.bin", flight / "comp").begins.sum() == 1


@pytest.mark.parametrize("same", [0, 3])
def test_two_runs_in_one_log_are_proved_also_where_they_begin_alike(flight, tmp_path, same):
    """Three equal periods of the second run were taken for repeats of the first's."""
    data = (flight / "flight.bin").read_bytes()
    length = struct.unpack_from("<I", data, 4)[0]
    heard = data[: 50 * length]
    other = data[: same * length] + flown(tmp_path / "comp", wanted=f"k + 1 <= {same} ? 0.1 : 0.2")[same * length :]
    (tmp_path / "two.bin").write_bytes(heard + other)
    found = wg.prove_flown(tmp_path / "two.bin", flight / "comp")
    assert found.proved, found
    assert (len(found), found.begins.sum(), found.repeated) == (50 + PERIODS - len(LOST), 2, 0)
    lagging = b"".join(heard[k * length : (k + 1) * length] for j in range(50) for k in (j, max(j - 2, 0)))
    (tmp_path / "topics.bin").write_bytes(lagging)
    found = wg.prove_flown(tmp_path / "topics.bin", flight / "comp")
    assert found.proved, found
    assert (len(found), found.begins.sum(), found.repeated) == (50, 1, 50)


@pytest.mark.parametrize(("push", "proved"), [("0", True), ("1.2e-3f", False), ("2e-6f", False)])
def test_an_estimate_that_is_walked_from_outside_is_found(tmp_path, push, proved):
    """By less than the tolerance of wrenches in each period, it went to its bound in a flight that was "proved"."""
    walk = f"memory.estimate[2] += {push}; memory.integral[2] += 0.2f * {push};"
    options = {"precision": "float", "observer": 2.0, "observer_max": 0.3}
    (tmp_path / "flight.bin").write_bytes(flown(tmp_path / "comp", walk=walk, **options))
    found = wg.prove_flown(tmp_path / "flight.bin", tmp_path / "comp")
    assert found.proved == proved, found
    assert found.agrees.all()
    assert proved == (found.identical.sum() == len(found))


def test_small_pushes_are_added_up(flight, tmp_path):
    """Each within the last places of two builds, together beyond the tolerance."""
    (tmp_path / "flight.bin").write_bytes((flight / "flight.bin").read_bytes())
    found = wg.prove_flown(tmp_path / "flight.bin", flight / "comp")
    pushed = np.where(found.follows[:, None], 5.0 * found.tolerance / len(found), 0.0) * np.ones(found.pushed.shape)
    for sign, whole in ((1.0, False), (np.where(np.arange(len(found)) % 2, 1.0, -1.0)[:, None], True)):
        again = replace(found)
        vars(again)["pushed"] = sign * pushed
        vars(again)["_rounding"] = 1.0
        assert again.proved == whole


@pytest.mark.parametrize("precision", ["double", "float"])
def test_another_build_that_rounds_otherwise_is_proved(tmp_path, precision):
    options = {"precision": precision, "observer": 2.0, "observer_max": 0.3}
    machine = ["-march=native"] if os.uname().machine == "x86_64" else []
    build = ("-O3", "-ffp-contract=fast", *machine)
    model = with_effects(com_offset=OFFSET, servo_lag=[0.06])
    (tmp_path / "flight.bin").write_bytes(flown(tmp_path / "comp", model=model, build=build, **options))
    found = wg.prove_flown(tmp_path / "flight.bin", tmp_path / "comp")
    assert found.proved, found


def test_ids_of_other_exports_are_not_listed_without_end(flight, tmp_path):
    data = (flight / "flight.bin").read_bytes()
    length = struct.unpack_from("<I", data, 4)[0]
    others = b"".join(
        resealed(data[:length], 0, lambda record, k=k: struct.pack_into("<Q", record, 8, k)) for k in range(500)
    )
    (tmp_path / "others.bin").write_bytes(others)
    with pytest.raises(LogError, match="and 497 more") as error:
        wg.prove_flown(tmp_path / "others.bin", flight / "comp")
    assert len(str(error.value)) < 500
    (tmp_path / "mixed.bin").write_bytes(others + data)
    assert "497 more" in str(wg.prove_flown(tmp_path / "mixed.bin", flight / "comp"))


def test_a_file_of_heads_without_records_is_read_within_its_budget(flight, tmp_path):
    data = (flight / "flight.bin").read_bytes()
    (tmp_path / "heads.bin").write_bytes(data[:28] * 20_000)
    with pytest.raises(LogError, match="--budget"):
        wg.prove_flown(tmp_path / "heads.bin", flight / "comp", budget="1GB,0.1s")


@pytest.mark.parametrize("name", ["wrenchgap_record.h", "wrenchgap_record.c"])
def test_the_tolerance_and_the_writing_of_records_are_those_of_the_export(flight, tmp_path, name):
    shutil.copytree(flight / "comp", tmp_path / "comp")
    code = tmp_path / "comp" / name
    code.write_text(code.read_text() + "\n")
    with pytest.raises(UsageError, match="not as `wrenchgap export` wrote them"):
        wg.prove_flown(flight / "flight.bin", tmp_path / "comp")


def test_a_file_beside_the_export_stands_in_for_no_header(flight, tmp_path):
    shutil.copytree(flight / "comp", tmp_path / "comp")
    for name in ("math.h", "string.h", "stdint.h", "stdio.h"):
        (tmp_path / "comp" / name).write_text("#error this is not the header of the C library\n")
    assert wg.prove_flown(flight / "flight.bin", tmp_path / "comp").proved


def test_records_are_found_between_other_bytes_and_damaged_ones_are_counted(flight, tmp_path):
    data = (flight / "flight.bin").read_bytes()
    length = struct.unpack_from("<I", data, 4)[0]
    damaged = bytearray(data[: 20 * length])
    damaged[5 * length + 300] ^= 1
    (tmp_path / "log").write_bytes(b"WGR1 in a title" + bytes(damaged) + b"\0\1WGR1\xff\xff\xff\xff" + data[:100])
    found = wg.prove_flown(tmp_path / "log", flight / "comp")
    assert found.proved
    assert (len(found), found.lost, found.damaged) == (19, 1, 4)


def test_records_on_a_topic_of_bytes(flight, tmp_path):
    """std_msgs/UInt8MultiArray in a compressed MCAP, as the ROS 2 node publishes it."""
    data = (flight / "flight.bin").read_bytes()
    length = struct.unpack_from("<I", data, 4)[0]
    with (tmp_path / "flight.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("std_msgs/msg/UInt8MultiArray", "ros2msg", b"uint8[] data\n")
        channel = writer.register_channel("/compensator/record", "cdr", schema)
        for k in range(0, len(data), length):
            payload = b"\0\1\0\0" + struct.pack("<I", length) + data[k : k + length]
            writer.add_message(channel, log_time=k, publish_time=k, data=payload)
        writer.finish()
    found = wg.prove_flown(tmp_path / "flight.mcap", flight / "comp")
    assert found.proved
    assert len(found) == PERIODS - len(LOST)


def test_what_cannot_be_proved_is_refused_in_one_line(flight, tmp_path):
    flown(tmp_path / "other", model=with_effects(com_offset=2 * OFFSET))
    with pytest.raises(LogError, match="name the folder that was flown"):
        wg.prove_flown(flight / "flight.bin", tmp_path / "other")
    code = tmp_path / "other" / "wrenchgap_compensator.c"
    code.write_text(code.read_text().replace("WG_OK", "0 * WG_OK"))
    with pytest.raises(UsageError, match="not as `wrenchgap export` wrote them"):
        wg.prove_flown(flight / "flight.bin", tmp_path / "other")
    (tmp_path / "other" / "wrenchgap_record.h").unlink()
    with pytest.raises(UsageError, match=r"has no wrenchgap_record\.h"):
        wg.prove_flown(flight / "flight.bin", tmp_path / "other")
    (tmp_path / "none.bin").write_bytes(bytes(1000))
    with pytest.raises(LogError, match="no record"):
        wg.prove_flown(tmp_path / "none.bin", flight / "comp")


def test_the_command_says_so_by_its_exit_code(flight, tmp_path, run, refused):
    changed = tmp_path / "changed.bin"
    changed.write_bytes(resealed((flight / "flight.bin").read_bytes(), 0, add(28 + 8 * 27, 1.0)))
    export = ("--export", flight / "comp")
    for code, log in {0: flight / "flight.bin", 3: changed}.items():
        done = run("replay", log, *export, "--json", f"{code}.json", "--csv", f"{code}.csv")
        assert done.exit_code == code, done.output
        assert json.loads((tmp_path / f"{code}.json").read_text())["proved"] == (code == 0)
        assert len((tmp_path / f"{code}.csv").read_text().splitlines()) == 1 + PERIODS - len(LOST)
    assert "Not proved: 1 of 398 recorded periods" in done.output
    assert "--cutoff says nothing about a flown export" in refused("replay", changed, *export, "--cutoff", 3)
    assert "--model MODEL is missing" in refused("replay", changed)


WRITTEN = [
    *(f"estimate[0] = {value}" for value in ("NAN", "2e6", "-INFINITY")),
    *(f"{name}[{k}] = {value}" for name in ("optimum", "known", "correction") for k, value in ((2, -5), (3, "NAN"))),
]
"""What something else does to the memory before a period."""


def test_a_memory_that_something_wrote_to_heals(tmp_path):
    """An estimate, or a correction on an axis that has none, was a wrong or saturated command for ever."""
    folder, settings = tmp_path / "comp", Settings(dt=DT, max_evaluations=12)
    wg.export_compensator(None, with_effects(com_offset=OFFSET), folder, settings, observer=2.0, observer_max=0.3)
    steps = "\n".join(
        f"""    wg_reset(&memory);
    memory.{written};
    wg_step(&memory, &in, &out);
    printf("%.9g %.9g %.9g %d\\n", (double)out.wrench_cmd[2], (double)out.wrench_cmd[3], (double)out.estimate[0],
           out.status);"""
        for written in WRITTEN
    )
    (tmp_path / "bad.c").write_text(f"""
#include "wrenchgap_compensator.h"
#include <math.h>
#include <stdio.h>
int main(void)
{{
    wg_memory memory;
    wg_input in = {{0}};
    wg_output out;
    in.wrench_desired[2] = 35;
    in.quat_EB[0] = 1;
{steps}
    return 0;
}}
""")
    words = [COMPILER, *STRICT, "-I", folder, "-o", tmp_path / "bad", tmp_path / "bad.c"]
    subprocess.run([str(w) for w in (*words, folder / "wrenchgap_compensator.c", "-lm")], check=True)
    lines = subprocess.run([tmp_path / "bad"], capture_output=True, text=True, check=True).stdout.splitlines()
    for written, line in zip(WRITTEN, lines, strict=True):
        thrust, torque, estimate, status = line.split()
        assert float(torque) == pytest.approx(np.cross(OFFSET, [0, 0, 35.0])[0], abs=1e-6), written
        assert float(thrust) == pytest.approx(35.0, abs=1e-9), written
        assert (float(estimate), int(status)) == (0.0, 0), written


def test_a_number_beyond_single_precision_is_not_exported_in_it(tmp_path):
    gp = process(np.random.default_rng(1).normal(size=(50, 6)))
    large = replace(gp, signal_variance=np.array([1e45, 1.0, 1.0]))
    with pytest.raises(UsageError, match="too large for --precision float"):
        wg.export_compensator(large, with_effects(), tmp_path / "comp", precision="float")


def test_a_state_that_no_record_holds_is_not_exported(tmp_path):
    """Honest flights of it could not be proved: their records were too long to be found."""
    late, settings = with_effects(command_delay=[0.1]), Settings(dt=0.00025, max_evaluations=12)
    with pytest.raises(UsageError, match="--without command_delay"):
        wg.export_compensator(None, late, tmp_path / "comp", settings, lead=0.05)
    with pytest.raises(UsageError, match="command_delay is 3000 s"):
        wg.export_compensator(None, with_effects(command_delay=[3000.0]), tmp_path / "comp", lead=0.05)
    with pytest.raises(UsageError, match="lead is 1000"):
        wg.export_compensator(None, with_effects(servo_lag=[0.06]), tmp_path / "comp", lead=1000.0)


def test_a_compiler_that_a_shell_could_not_read_is_told(monkeypatch):
    monkeypatch.setenv("CC", "gcc 'x")
    with pytest.raises(UsageError, match="CC=gcc 'x in the environment: No closing quotation"):
        records._compiler()
