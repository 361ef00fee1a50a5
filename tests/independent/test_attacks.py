"""Each attack of benchmarks/attacks keeps to its bound: the same program that makes the table of
benchmarks/notes/attacks.md, where a compensation is given five times as many draws."""

from concurrent.futures import ThreadPoolExecutor

import pytest

from benchmarks.attacks import areas, compensation


def cases():
    for area, attacks in areas().items():
        for attack in attacks:
            marks = [pytest.mark.slow] * attack.slow + [pytest.mark.browser] * attack.browser
            yield pytest.param(attack, id=f"{area}: {attack.what}"[:150], marks=marks)


@pytest.mark.slow
@pytest.mark.parametrize("attack", list(cases()))
def test_bound_holds(attack, tmp_path, monkeypatch):
    monkeypatch.setattr(compensation, "DRAWS", compensation.DRAWS // 5)
    with ThreadPoolExecutor(1) as own:  # no loop runs there: another test's browser may wait in this thread
        outcome = own.submit(attack.run, tmp_path).result() if attack.browser else attack.run(tmp_path)
    assert outcome.held, outcome.happened
