"""Results read the same wherever they were made: the top level says how, before anything else is imported."""

import subprocess
import sys

import pytest

import wrenchgap.learn

LOW = "from wrenchgap.plant import model_file; from wrenchgap.plant.drafts.draft import Sheet"


def test_a_result_of_a_low_floor_prints_without_an_import_of_the_application():
    code = f"{LOW}; print(repr(Sheet(model_file.load('crazyflie'))))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.startswith("crazyflie: ")


def test_a_package_that_is_called_says_what_to_call_instead():
    with pytest.warns(DeprecationWarning, match=r"call wrenchgap\.learn_gp"), pytest.raises(TypeError):
        wrenchgap.learn()
