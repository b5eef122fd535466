"""Mechanisms written by hand, and the two engines that judge them."""

import importlib.util
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def linkages():
    """The module beside this file; tests are not a package, so it is loaded by its path."""
    spec = importlib.util.spec_from_file_location("linkages", Path(__file__).with_name("linkages.py"))
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def simulate_exudyn():
    pytest.importorskip("exudyn", reason="Exudyn is not installed: pip install linktwin[peers]")
    from backend.blind.exudyn_engine import simulate_exudyn

    return simulate_exudyn


@pytest.fixture(scope="session")
def simulate_mujoco():
    pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install linktwin[peers]")
    from backend.blind.mujoco_engine import simulate_mujoco

    return simulate_mujoco


@pytest.fixture(params=["exudyn", "mujoco"])
def simulate(request):
    """Either engine; what is tested with it is true of both."""
    return request.getfixturevalue(f"simulate_{request.param}")
