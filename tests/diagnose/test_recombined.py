"""Pairs put together anew: the truth may be two exchanges away from every pair that leads."""

from types import SimpleNamespace

from backend.diagnose.recombined import recombined


class Tried(SimpleNamespace):
    """A search that only remembers what it was asked to fit."""

    def begun_at(self, home, members, values):
        self.asked.append((home.names, tuple(m.name for m in members), dict(values)))
        return SimpleNamespace(log_z=0.0, names=tuple(sorted(m.name for m in members)))


def member(name: str):
    kind, _, place = name.partition(":")
    return SimpleNamespace(name=name, kind=kind, on=(place,), parameters=(SimpleNamespace(name=f"{name}.size"),))


def searched(worth: dict[tuple[str, str], float], fraction: float = 1.0):
    subject = SimpleNamespace()
    search = Tried(subject=subject, forms={("dry:j1", "wide:j1")}, asked=[], cancelled=lambda: False, tried={})
    for pair, log_z in worth.items():
        names = tuple(sorted(pair))
        search.tried[names] = SimpleNamespace(
            names=names, candidates=tuple(map(member, pair)), log_z=log_z,
            fitted=SimpleNamespace(fraction=fraction, subject=subject),
            values={f"{name}.size": log_z for name in pair},
        )  # fmt: skip
    return search, max(search.tried.values(), key=lambda c: c.log_z)


def test_the_friction_of_one_pair_is_tried_with_the_mass_of_another_and_begins_where_they_ended():
    search, best = searched({("wide:all", "mass:rod"): -10.0, ("wide:j1", "mass:rod"): -12.0,
                             ("wide:all", "mass:block"): -15.0})  # fmt: skip
    found = recombined(search, best)
    assert [c.names for c in found] == [("mass:block", "wide:j1")]
    home, members, values = search.asked[0]
    assert home == ("mass:rod", "wide:j1")
    assert set(members) == {"mass:block", "wide:j1"}
    assert values == {"mass:block.size": -15.0}


def test_no_pair_is_asked_twice_nor_two_of_a_kind_nor_a_form_beside_a_simpler_one_that_it_contains():
    search, best = searched({("dry:j1", "mass:rod"): -10.0, ("wide:j1", "mass:rod"): -11.0,
                             ("dry:j1", "mass:block"): -12.0, ("wide:j1", "mass:block"): -13.0})  # fmt: skip
    assert recombined(search, best) == []
    assert search.asked == []


def test_pairs_that_follow_less_of_the_records_lend_no_member():
    search, best = searched({("wide:all", "mass:rod"): -10.0})
    short, _ = searched({("wide:j1", "mass:block"): -1.0}, fraction=0.5)
    search.tried |= short.tried
    assert recombined(search, best) == []
