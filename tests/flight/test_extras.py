"""What only one feature needs is an extra, whose absence is told in one line with the command that installs it."""

import re
import sys
import tomllib
from pathlib import Path

import pytest

from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.extras import EXTRAS, needed_for

PROJECT = tomllib.loads((Path(__file__).resolve().parents[2] / "pyproject.toml").read_text(encoding="utf-8"))["project"]
DISTRIBUTIONS = {"PIL": "pillow", "google": "protobuf"}


def distributions(requirements):
    return {re.match(r"[\w-]+", one).group().lower() for one in requirements}


@pytest.mark.parametrize("package", EXTRAS)
def test_an_extra_installs_its_package_and_the_base_does_not(package):
    name = DISTRIBUTIONS.get(package, package)
    assert name in distributions(PROJECT["optional-dependencies"][EXTRAS[package]])
    assert name not in distributions(PROJECT["dependencies"])


def test_all_has_every_extra_that_a_package_is_in():
    named = re.search(r"\[(.*)\]", PROJECT["optional-dependencies"]["all"][0]).group(1).split(",")
    assert set(EXTRAS.values()) == set(named)


@pytest.mark.parametrize("package", ["pandas", "viser", "pyulog"])
def test_what_is_missing_is_told_with_the_command_that_installs_it(package, monkeypatch):
    monkeypatch.setitem(sys.modules, package, None)
    said = rf"^pages need {package}, .*pip install 'wrenchgap\[{EXTRAS[package]}\]'$"
    with pytest.raises(UsageError, match=said), needed_for("pages"):
        __import__(package)


def test_a_fault_of_wrenchgap_itself_is_not_called_a_missing_package():
    with pytest.raises(ModuleNotFoundError, match="wrenchgap_nowhere"), needed_for("pages"):
        __import__("wrenchgap_nowhere")
