import runpy
from pathlib import Path

EXAMPLE = Path(__file__).parents[2] / "examples" / "02_compensator_in_your_loop.py"


def test_compensator_in_a_strangers_loop(capsys):
    """The example's plant shares no code with the fit; on its unseen flight at least 95 % of the error goes."""
    errors = runpy.run_path(str(EXAMPLE))["main"]()
    assert (errors["before"] > 0.02).all()
    assert (errors["after"] < 0.05 * errors["before"]).all()
    assert capsys.readouterr().out.count("\n") == 3
