import numpy as np

from backend.diagnose.subject import Subject


def test_slopes_about_a_motion_close_to_one_that_was_swept_are_not_taken_again():
    subject = Subject(None, None, None, [], [], None, None, 1e-3, ())  # type: ignore[arg-type]
    left = np.random.default_rng(0).standard_normal(1000)
    swept = []

    def sweep():
        swept.append(len(swept))
        return swept[-1]

    assert subject.alike("library", left, sweep) == 0
    assert subject.alike("library", 1.1 * left, sweep) == 0  # a hundredth of what is left apart
    assert subject.alike("library", -left, sweep) == 1
    assert subject.alike("library", left[:500], sweep) == 2  # a shorter part of the records
    assert subject.alike("forces", left, sweep) == 3
