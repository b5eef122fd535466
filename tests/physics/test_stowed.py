"""A stowed scissor and a fallen parallelogram, their contacts found in the drawing or declared by hand."""

import numpy as np

from backend.model.build import build
from benchmarks.scissor import LENGTH_M, WIDTH_M, scissor
from tests.mechanisms import SPAN_M, effect, parallelogram
from tests.motions import follow

STEP_S, NODES = 1e-3, 450


def pushed_together(contacts):
    """Five cells, half folded, pushed together at the far end."""
    folded = scissor(5, angle_rad=1.3, spring_n_per_m=0.0)
    push = effect("push", "applied_force", ["a4"], direction=[-1, 0, 0], force_n=2.0)
    drag = effect("drag", "viscous_friction", "all", damping_n_m_s_per_rad=0.05)
    return build(folded.model_copy(update={"effects": (push, drag, *contacts)}))


def test_found_contacts_stow_a_scissor_as_those_declared_by_hand_do():
    ends = {
        f"{end}_{side}_m": [x, 0, 0] for side in "ab" for end, x in (("start", -LENGTH_M / 2), ("end", LENGTH_M / 2))
    }
    by_hand = [
        effect(f"{bar}{i}", "link_contact", [f"{bar}{i}", f"{bar}{i + 1}"], radius_a_m=0.005, radius_b_m=0.005, **ends)
        for bar in "ab"
        for i in range(4)
    ]
    places = []
    for contacts in (by_hand, [effect("meet", "link_contact", "all")]):
        model = pushed_together(contacts)
        path = follow(model, STEP_S, NODES).path
        places.append(np.stack([path.pose.position[:, model.topology.slot(f"a{i}"), 0] for i in range(5)]))
    # 24 further pairs, none of which touches, each with a barrier's push: 0.1 µm.
    np.testing.assert_allclose(places[1], places[0], atol=1e-7)
    assert 4 * WIDTH_M < places[1][4, -1] - places[1][0, -1] < 4.01 * WIDTH_M


def test_a_parallelogram_falls_flat_onto_its_ground_as_with_the_contact_declared_by_hand():
    ends = {f"{end}_{side}_m": [x, 0, 0] for side in "ab" for end, x in (("start", 0.0), ("end", SPAN_M))}
    by_hand = effect("rest", "link_contact", ["ground", "coupler"], radius_a_m=0.005, radius_b_m=0.005, **ends)
    heights = []
    for contact in (by_hand, effect("meet", "link_contact", "all")):
        drag = effect("drag", "viscous_friction", "all", damping_n_m_s_per_rad=1e-3)
        model = build(parallelogram([drag, contact]))
        heights.append(follow(model, STEP_S, 400).path.pose.position[:, model.topology.slot("coupler"), 1])
    # The pair of cranks, which never touch, has a barrier's push: 0.1 µm.
    np.testing.assert_allclose(heights[1], heights[0], atol=1e-7)
    np.testing.assert_allclose(heights[1][-1], WIDTH_M, atol=1e-6)
    assert heights[1][0] > 8 * WIDTH_M
