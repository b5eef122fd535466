"""Linkages side by side on one ground: one model to compile and one file to load."""

from collections.abc import Mapping

from backend.mechanism.kinds import effect_kinds
from backend.mechanism.mechanism import Mechanism
from backend.mechanism.read import parse_mechanism
from tests.mechanisms import document


def beside(linkages: Mapping[str, Mechanism], gravity: tuple[float, float, float]) -> Mechanism:
    """One drawing of them all; ids are `name.id`, and all share one ground."""
    whole = {"schema_version": "1.0", "name": "side by side", "gravity_m_per_s2": list(gravity)}
    bodies, joints, effects, markers = [], [], [], []
    for name, mechanism in linkages.items():
        drawn = document(mechanism)

        def named(id: str, name: str = name) -> str:
            return id if id == "ground" else f"{name}.{id}"

        bodies += [{**b, "id": named(b["id"])} for b in drawn["bodies"] if b["id"] != "ground"]
        joints += [
            {**j, "id": named(j["id"]), "body_a": named(j["body_a"]), "body_b": named(j["body_b"])}
            for j in drawn["joints"]
        ]
        for effect in drawn.get("effects", []):
            kind = effect_kinds()[effect["kind"]]
            suited = [j["id"] for j in drawn["joints"] if kind.suits(j["type"])]
            on = suited if effect["on"] == "all" else effect["on"]
            effects.append({**effect, "id": named(effect["id"]), "on": [named(id) for id in on]})
        markers += [{**m, "id": named(m["id"]), "body": named(m["body"])} for m in drawn.get("markers", [])]
    ground = {"id": "ground", "fixed": True, "pose": {"position_m": [0, 0, 0], "quaternion_wxyz": [1, 0, 0, 0]}}
    whole |= {"bodies": [ground, *bodies], "joints": joints, "effects": effects, "markers": markers}
    return parse_mechanism(whole)


def turned_about(mechanism: Mechanism, *joints: str) -> Mechanism:
    """The same linkage with body A and body B of some joints exchanged."""
    drawn = document(mechanism)
    for joint in drawn["joints"]:
        if joint["id"] in joints:
            joint["body_a"], joint["body_b"] = joint["body_b"], joint["body_a"]
            joint["frame_a"], joint["frame_b"] = joint["frame_b"], joint["frame_a"]
    return parse_mechanism(drawn)
