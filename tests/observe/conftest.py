import numpy as np
import pytest

from backend.blind.camera import Bed, Camera

from .scenes import eight, film, four


@pytest.fixture(scope="session")
def eight_dots(tmp_path_factory):
    """Eight dots on seven bars, 1280 x 720, 240 frames a second, 0.5 mm per pixel."""
    marks = {"a": (-0.29, -0.15), "b": (0.29, -0.15), "c": (0.29, 0.15), "d": (-0.29, 0.15), "e": (0, 0.16)}
    bars = [(f"m{k}", f"m{k + 1}") for k in range(7)]
    path = tmp_path_factory.mktemp("eight") / "eight.mp4"
    return film(path, np.arange(160) / 240, eight, bars, Camera(), Bed(marks))


@pytest.fixture(scope="session")
def four_dots(tmp_path_factory):
    """Four dots on two bars in a small picture, 60 frames."""
    path = tmp_path_factory.mktemp("four") / "four.mp4"
    return film(path, np.arange(60) / 240, four, [("base", "swing"), ("post", "wheel")])
