"""The page of real defects: names of cases are read right, and answers are judged by what was done to the vehicle."""

from pathlib import Path

import pytest

from benchmarks.real_defects import blades_of, case_of, comparisons, kind_of
from benchmarks.real_defects_page import detail, is_rotor, page, wrong


def row(case, firm=(), where="", probability=0.0, verdict="nothing", suspect=("a", "b"), healthy=("h",) * 5):
    return {
        "case": case,
        "kind": kind_of(case),
        "blades": blades_of(case),
        "suspect": suspect,
        "healthy": healthy,
        "verdict": verdict,
        "firm": firm,
        "where": where,
        "probability": probability,
        "effect": "rotor_thrust",
        "change": -0.1,
        "uncertain": 0.02,
        "significance": 5.0,
        "nothing": 0.02,
        "odd": (),
        "alone": "mass added 0 kg",
        "log_odds": -1.0,
        "com_towards": "M4",
        "com_significance": 1.0,
        "com_mm": 0.5,
        "summary": "",
    }


@pytest.mark.parametrize(
    ("case", "blades"),
    [
        ("cut_propeller_M3_2mm_1.5mm_43.5mm", (2.0, 1.5)),
        ("cut_propeller_M3_0.5mm_46.5mm", (0.5, 0.0)),
        ("cut_propeller_M3_3mm", (3.0, 0.0)),
        ("add_weight_W1_near_M4", ()),
    ],
)
def test_cuts_of_both_blades_are_read_from_the_name(case, blades):
    assert blades_of(case) == blades
    assert case_of(Path(f"{case}__E8_log01_con.mcap")) == case


def test_another_rotor_or_another_name_is_wrong():
    cut = "cut_propeller_M3_3mm_3mm_41mm"
    right = row(cut, ("rotor_thrust",), "M3", 0.99, "changed")
    assert is_rotor(right)
    assert not wrong(right)
    assert wrong(row(cut, ("rotor_thrust",), "M1", 0.99, "changed"))
    assert wrong(row(cut, ("com_offset",), "", 0.0, "changed"))
    assert wrong(row("normal_flight", ("com_offset",), "", 0.0, "changed"))
    assert not wrong(row("add_weight_W1_near_M4", ("payload",), "", 0.0, "changed"))


def test_the_page_counts_what_the_rows_say():
    cut = "cut_propeller_M3_3mm_3mm_41mm"
    rows = [
        row(cut, ("rotor_thrust",), "M3", 0.99, "changed"),
        row("cut_propeller_M3_2mm_2mm_43mm"),
        row("add_weight_W1_near_M4"),
        row("normal_flight", suspect=("a",), healthy=("b",)),
    ]
    text = page(rows)
    assert "1 of 2 cases" in text
    assert "missed: M3 cut 2 mm and 2 mm" in text
    assert "| wrong firm names: 0 | 0 of 4 |" in text
    assert "| healthy against healthy: nothing changed | 1 of 1 ordered pairs" in text


def test_what_explain_says_alone_is_judged_by_what_was_done():
    def alone(case, firm, sets):
        common = {"flights": ("a", "b"), "verdict": "effect", "rotors": {"M1": 0.01, "M3": -0.2}}
        return {"case": case, "kind": kind_of(case), "blades": blades_of(case), "firm": firm, "sets": sets, **common}

    right = alone("cut_propeller_M3_3mm_3mm_41mm", ("rotor_thrust", "motor_lag"), [[["rotor_thrust"], 0.9], [[], 0.1]])
    other = alone("cut_propeller_M3_2mm_2mm_43mm", ("tether",), [[["tether"], 1.0]])
    text = detail([], [right, other])
    assert "rotor_thrust 90 %; nothing 10 % | M3, -20 % |" in text
    assert "wrong: 1 of 2 cases (M3 cut 2 mm and 2 mm)" in text
    assert "1 of 2 cases with 2 mm or more" in text


def test_every_defect_is_compared_with_all_normal_flights(tmp_path):
    names = ["normal_flight__E8_log00.mcap", "normal_flight__E8_log01.mcap", "cut_propeller_M3_3mm__E8_log00.mcap"]
    for name in names:
        (tmp_path / name).touch()
    listed = [(case, len(suspects), len(healthy)) for case, suspects, healthy in comparisons(tmp_path)]
    assert listed[0] == ("cut_propeller_M3_3mm", 1, 2)
    assert [item for item in listed if item[0] == "normal_flight"] == [("normal_flight", 1, 1)] * 4
