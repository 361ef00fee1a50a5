"""The same command gives the same numbers: in another process, with other hashes, threads and numbers of processes.

What differs is the wall clock alone: how long the optimiser took.
"""

import json
import os
import subprocess
import sys
import zipfile

import pytest

pytestmark = pytest.mark.slow
CHILD = """
import json, sys
import wrenchgap as wg

train, test, ideal, jobs = *sys.argv[1:4], int(sys.argv[4])
model = wg.load_model("tilt_hexarotor")
flights = wg.open_flights([train], model, between=(1.0, 7.0))
unseen = wg.open_flights([test], model, between=(1.0, 5.0))
found = {"inspect": wg.inspect(test, model), "compare": wg.compare(unseen, model)}
found["explain"] = wg.explain(flights, model, names=("com_offset", "mass", "body_drag"), jobs=jobs)
settings = wg.learn.process.gp.FitSettings(points=25)
found["learn"] = wg.learn_gp(flights, model, settings=settings, guard=False)
wg.save_gp(found["learn"], sys.argv[5])
found["replay"] = wg.replay_compensation(unseen[0], model, found["learn"])
found["counterfactual"] = wg.counterfactual(unseen[0], model, gp=found["learn"], duration=1.0)
well = wg.open_flights([ideal], model, between=(1.0, 7.0))
found["changed"] = wg.changed(flights, well, model, names=("com_offset", "mass"), jobs=jobs)
documents = {name: result.to_json() for name, result in found.items()}
arrays = found["replay"].steps.correction.tobytes().hex()
print(json.dumps({**documents, "correction": arrays}, sort_keys=False, default=str))
"""
CLOCK = {"solve_mean_ms", "solve_p99_ms", "solve_max_ms"}
KINDS = ("inspect", "compare", "explain", "learn", "replay", "counterfactual", "changed", "correction")


def without_clock(value):
    if isinstance(value, dict):
        return {key: without_clock(inner) for key, inner in value.items() if key not in CLOCK}
    return [without_clock(inner) for inner in value] if isinstance(value, list) else value


@pytest.fixture(scope="module")
def twice(logs, tmp_path_factory):
    """The documents and the stored process of two processes that differ in all that should not matter."""
    folder, running = tmp_path_factory.mktemp("twice"), []
    for number, hashes in ((1, "0"), (2, "4242")):
        threads = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
        env = os.environ | dict.fromkeys(threads, str(number)) | {"PYTHONHASHSEED": hashes}
        words = [logs.train, logs.test, logs.ideal, number, folder / f"{number}.gp"]
        run = subprocess.Popen([sys.executable, "-c", CHILD, *map(str, words)], env=env, stdout=subprocess.PIPE)
        running.append(run)
    outputs = [run.communicate()[0] for run in running]
    assert [run.returncode for run in running] == [0, 0]
    stored = []
    for number in (1, 2):
        with zipfile.ZipFile(folder / f"{number}.gp") as archive:
            stored.append({name: archive.read(name) for name in archive.namelist()})
    return [json.loads(text) for text in outputs], stored


@pytest.mark.parametrize("kind", KINDS)
def test_the_same_numbers_in_another_process_with_other_hashes_threads_and_jobs(kind, twice):
    one, other = (json.dumps(without_clock(documents[kind])) for documents in twice[0])
    assert one == other


def test_the_stored_process_is_the_same_byte_for_byte_but_for_its_date(twice):
    one, other = ({name: part for name, part in parts.items() if name != "gp.json"} for parts in twice[1])
    assert one == other
    said = [json.loads(parts["gp.json"]) for parts in twice[1]]
    for about in said:
        # The sum is taken over the date too: two processes that end in different seconds differ in both.
        del about["provenance"]["date"], about["sha256"]
    assert said[0] == said[1]
