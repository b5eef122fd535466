"""What a newcomer, a keyboard, a phone and a dark room see of the page, in a real Chromium."""

from __future__ import annotations

import json

from backend.service.keys import make_key, revoke_key
from backend.service.service import open_service
from backend.service.settings import Settings
from tests.browser.conftest import COOKIE, PREPARED, SAMPLE
from tests.browser.cost import spent_s

PLAYED_MS = 1500
FRAMES = """async (ms) => {
  const stage = document.querySelector(".stage"), play = stage.querySelector(".stage-play");
  play.click(); await new Promise((done) => setTimeout(done, ms)); play.click();
  const stamps = stage.stamps, busy = [...stage.busy].sort((a, b) => a - b);
  return [1000 * (stamps.length - 1) / (stamps.at(-1) - stamps[0]), busy[Math.floor(busy.length / 2)], stamps.length];
}"""


def test_a_newcomer_goes_from_a_sample_to_its_gap_report(visit, study, diagnosis):
    page = visit()
    assert page.locator("h1").inner_text() == "Why does the real one differ from the drawing?"
    page.goto(page.url + study)
    page.wait_for_selector(".stage[data-ready]")
    assert page.locator("dl.facts").inner_text().split("\n")[:2] == ["moving bodies", "1"]
    assert page.locator(".act.primary").count() == 1
    page.goto(page.url.replace(study, diagnosis))
    page.wait_for_selector(".stage[data-replay]")
    report = json.loads((PREPARED / "diagnose" / "gap.json").read_text())
    told = page.locator("#content").inner_text()
    assert report["sentence"] in told
    assert "coulomb friction at pivot" in told
    assert "joint pivot" in told
    assert page.get_by_role("link", name="Download everything").get_attribute("href").endswith("/all.zip")


def test_the_motion_plays_in_the_browser_and_the_charts_follow(visit, diagnosis, capsys):
    page = visit(diagnosis)
    page.wait_for_selector(".stage[data-replay]")
    asked = []
    page.on("request", lambda request: asked.append(request.url))
    before = spent_s()
    per_s, own_ms, frames = page.evaluate(FRAMES, PLAYED_MS)
    cost = ", ".join(f"{1e3 * (s - before[role]) / frames:.0f} ms {role}" for role, s in spent_s().items())
    with capsys.disabled():
        print(
            f"\nplayback: {per_s:.0f} frames a second without a graphics card; a frame takes {own_ms:.1f} ms of script,"
        )
        print(f"          of processor time {cost}")
    assert frames > 2  # it moves; how smoothly is the machine's matter, and printed above
    assert asked == []  # sent once
    page.locator("svg.chart").first.scroll_into_view_if_needed()
    page.locator("svg.chart").first.click(position={"x": 200, "y": 100})
    page.wait_for_selector("i.now:not([hidden])")
    clicked = page.locator(".stage output").inner_text()
    assert 0.4 < float(clicked.removesuffix(" s")) < 1.6  # the middle of a chart from 0 to 2.25 s
    page.locator(".stage-view").press("Space")
    page.wait_for_function("was => document.querySelector('.stage output').textContent !== was", arg=clicked)


def test_what_was_fitted_is_read_and_played_beside_what_was_measured(visit, study):
    page = visit(study)
    page.get_by_role("button", name="Fit", exact=True).click()
    page.wait_for_url("**/jobs/*")
    page.wait_for_selector(".stage[data-replay]")
    (friction,) = json.loads((PREPARED / "fit" / "fit.json").read_text())["parameters"]
    row = page.locator("tr", has_text="coulomb friction at pivot").inner_text()
    assert "friction torque" in row
    assert f"{1e3 * friction['value']:.3f}"[:4] in row
    assert f"{1e3 * friction['ci95'][0]:.3f} … {1e3 * friction['ci95'][1]:.3f}" in row
    assert page.locator(".stage-layers label").all_inner_texts()[:3] == ["fitted twin", "as drawn", "measured"]
    before = page.locator(".stage output").inner_text()
    page.locator(".stage-play").click()
    page.wait_for_function("was => document.querySelector('.stage output').textContent !== was", arg=before)


def test_a_jam_is_shown_where_it_holds_and_since_when(visit):
    page = visit()
    page.set_input_files("input[type=file]", PREPARED / "drawer.json")
    page.wait_for_url("**/mechanisms/*")
    page.get_by_role("button", name="Does it jam?").click()
    page.wait_for_url("**/jobs/*")
    page.wait_for_selector(".stage[data-replay]")
    told = page.locator("#content").inner_text()
    assert "Does drawer jam?" in told
    assert json.loads((PREPARED / "jam" / "jam.json").read_text())["sentence"] in told
    assert page.locator(".stage output").inner_text() == "0.002 s"  # it opens where it came to rest
    assert page.locator(".stage-names .force").count() == 0  # what its joint carries is rounding error
    page.goto(page.url.replace(page.url.split("/ui/")[1], "work"))
    assert "drawer" in page.locator("table").inner_text()


def test_whoever_has_a_key_signs_in_and_out(visit, served, study):
    page = visit(signed_in=False)
    page.get_by_label("API key").fill("lt_wrong")
    page.get_by_role("button", name="Sign in").click()
    page.get_by_text("unknown or was revoked").wait_for()
    page.goto(page.url.split("?")[0] + study)
    assert page.get_by_role("heading", name="Sign in").is_visible()
    page.get_by_label("API key").fill(served[1])
    page.get_by_role("button", name="Sign in").click()
    page.locator(f"a[href$='{study}']").wait_for()
    page.get_by_role("button", name="Sign out").click()
    page.get_by_role("heading", name="Sign in").wait_for()


def test_an_open_view_ends_with_its_key(visit, served, folder):
    service = open_service(Settings(data_folder=str(folder)))
    key, text = make_key(service.database, "passer-by")
    page = visit(signed_in=False)
    page.context.add_cookies([{"name": COOKIE, "value": text, "url": served[0]}])
    page.goto(served[0])
    page.get_by_text("Sign out").wait_for()
    revoke_key(service.database, key.id)
    page.get_by_text("unknown or was revoked").wait_for()  # nothing was pressed
    service.close()


def test_who_has_nothing_yet_is_told_what_to_do(visit, served, folder):
    service = open_service(Settings(data_folder=str(folder)))
    _, text = make_key(service.database, "beginner")
    service.close()
    page = visit(signed_in=False)
    page.context.add_cookies([{"name": COOKIE, "value": text, "url": served[0]}])
    page.goto(served[0])
    assert page.locator("h2").all_inner_texts() == ["Samples", "Bring your own"]  # no list of nothing
    assert "begin here" in page.locator("[data-sample=pendulum]").inner_text()
    drop = page.locator(".drop")
    assert "Drop mechanism.json and its meshes here" in drop.inner_text()
    assert drop.get_by_role("button", name="Choose files").is_visible()
    page.get_by_role("link", name="Work", exact=True).click()
    page.get_by_text("Nothing was asked yet").wait_for()
    assert "ask whether it jams, or open a study and diagnose it" in page.locator(".empty").inner_text()
    page.get_by_role("link", name="To the mechanisms").click()
    page.locator("[data-sample=pendulum]").wait_for()


def test_work_is_watched_and_cancelled(visit, tmp_path):
    page = visit()
    page.set_input_files("input[type=file]", SAMPLE / "mechanism.json")
    page.wait_for_url("**/mechanisms/*")
    page.get_by_label("how long [s]").fill("600")  # minutes of work
    page.get_by_role("button", name="Let it move").click()
    page.wait_for_url("**/jobs/*")
    assert page.get_by_role("progressbar").is_visible()
    page.get_by_role("button", name="Cancel").click()
    page.get_by_text("Nothing was kept of it").wait_for()
    assert page.get_by_role("link", name="Back").is_visible()


def test_everything_is_reached_by_keyboard(visit, study):
    page = visit()
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.textContent") == "Skip to the content"
    for _ in range(30):
        page.keyboard.press("Tab")
        if page.evaluate("document.activeElement.getAttribute('href') ?? ''").endswith(study):
            break
    assert page.evaluate("getComputedStyle(document.activeElement).outlineStyle") == "solid"
    page.keyboard.press("Enter")
    page.wait_for_url(f"**/{study}")
    view = page.locator(".stage[data-ready] .stage-view")
    view.focus()
    page.wait_for_function("document.querySelector('.stage-scale span').textContent !== ''")
    before = page.locator(".stage-scale span").inner_text()
    for _ in range(8):
        page.keyboard.press("+")
    page.wait_for_function("was => document.querySelector('.stage-scale span').textContent !== was", arg=before)


def test_it_fits_a_phone(visit, diagnosis):
    page = visit(diagnosis, width=390, height=844)
    page.wait_for_selector(".stage[data-replay]")
    assert page.evaluate("document.documentElement.scrollWidth") == 390
    small = page.evaluate(
        "[...document.querySelectorAll('#content button')].filter((b) => b.offsetHeight && b.offsetHeight < 24).length"
    )
    assert small == 0  # each can be hit with a finger


def test_it_follows_a_dark_room_and_its_own_switch(visit, diagnosis):
    page = visit(diagnosis, scheme="dark")
    page.wait_for_selector(".stage[data-ready]")
    paper = "getComputedStyle(document.body).backgroundColor"
    assert page.evaluate(paper) == "rgb(20, 24, 28)"
    page.get_by_role("button", name="Switch between light and dark").click()
    page.wait_for_function(f"{paper} === 'rgb(251, 251, 249)'")
    page.reload()
    page.wait_for_function(f"{paper} === 'rgb(251, 251, 249)'")


def test_a_link_shows_a_result_to_others_and_nothing_else(visit, diagnosis):
    page = visit(diagnosis)
    page.get_by_role("button", name="Share").click()
    page.wait_for_function("document.getElementById('share-link').value !== ''")
    shared = page.locator("#share-link").input_value()
    page.goto(shared)
    page.wait_for_selector(".stage[data-ready]")
    assert "coulomb friction" in page.locator("#content").inner_text()
    assert page.get_by_text("Delete this result").count() == 0
    page.goto(shared[:-1] + ("0" if shared[-1] != "0" else "1"))
    assert "cut short" in page.locator("#content").inner_text()


def test_what_is_wrong_with_a_drawing_is_said_with_its_remedy(visit, tmp_path):
    bad = json.loads((SAMPLE / "mechanism.json").read_text())
    bad["joints"][0]["body_b"] = "lnk"
    (tmp_path / "mechanism.json").write_text(json.dumps(bad))
    page = visit()
    page.set_input_files("input[type=file]", tmp_path / "mechanism.json")
    page.wait_for_selector("[role=alert]")
    said = page.locator("[role=alert]").inner_text()
    assert '"lnk" is not a body' in said
    assert "link" in said
    home = page.url
    for lost in ("mechanisms/nowhere", "nowhere/at/all"):
        page.goto(home + lost)
        assert "To your mechanisms" in page.locator("#content").inner_text()
