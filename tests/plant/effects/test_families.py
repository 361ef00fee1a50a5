"""Several forms of one effect are one name."""

from wrenchgap.plant.effects import catalogue, families, family, find


def test_forms_of_a_family_are_of_one_place_and_say_what_they_are():
    for shared, names in families().items():
        assert shared in names  # the first form gives it its name
        assert len({find(n).place for n in names}) == 1
        assert len({find(n).form for n in names}) == len(names)
        assert all(find(n).form for n in names)
        assert all(set(names) - {n} <= set(find(n).confused_with) for n in names)


def test_every_effect_has_a_family():
    assert families()["ground_effect"] == ("ground_effect", "ground_effect_one_height")
    assert family("ground_effect_one_height") == "ground_effect"
    alone = set(catalogue()) - {n for names in families().values() for n in names}
    assert all(family(n) == n and not find(n).form for n in alone)


def test_confusion_is_mutual_among_effects_that_came_later():
    for name in ("thrust_curve", "thrust_fade", "asymmetric_motor_lag"):
        assert all(name in find(other).confused_with for other in find(name).confused_with)
