"""A diagnosis runs one program hundreds of times."""

import pytest


@pytest.fixture(scope="module")
def run_often() -> bool:
    return True
