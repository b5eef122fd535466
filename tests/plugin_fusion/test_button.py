"""The whole add-in in a Fusion that is a fake: start, press, watch, stop."""

import importlib
import json
import sys
from pathlib import Path

import pytest

from backend.mechanism.read import read_mechanism
from tests.plugin_fusion import fakes
from tests.plugin_fusion.addin import room
from tests.plugin_fusion.fake_adsk import FakeFusion
from tests.plugin_fusion.local_service import KEY, MECHANISM, local_service
from tests.plugin_fusion.test_reader import design

EXPORT, SETTINGS = "linktwin_export", "linktwin_settings"


@pytest.fixture
def opened(monkeypatch):
    """The pages that were opened in a browser."""
    pages: list[str] = []
    monkeypatch.setattr("webbrowser.open", pages.append)
    return pages


@pytest.fixture
def start(tmp_path, monkeypatch, opened):
    """Starts the add-in in a fake Fusion with settings, and stops it when the test ends."""
    monkeypatch.setenv("LINKTWIN_FUSION_SETTINGS", str(tmp_path / "settings" / "fusion.json"))
    for name in [name for name in sys.modules if name.startswith("LinkTwin.") and ".lib" not in name]:
        monkeypatch.delitem(sys.modules, name)  # they hold the last test's adsk
        monkeypatch.delattr(f"LinkTwin.{name.split('.')[1]}", raising=False)
    running = []

    def start(product=None, url="", key="", **told) -> FakeFusion:
        fusion = FakeFusion(product, **told)
        for name, module in fusion.modules().items():
            monkeypatch.setitem(sys.modules, name, module)
        settings = room("lib.settings")
        settings.store(settings.Settings(url=url, key=key, folder=str(tmp_path / "exports")), settings.settings_path())
        addin = importlib.import_module("LinkTwin.LinkTwin")
        addin.run({})
        running.append((addin, fusion))
        return fusion

    yield start
    for addin, fusion in running:
        addin.stop({})
        assert fusion.controls.things == fusion.definitions.things == fusion.palettes.things == {}
        assert not fusion._events


def steps(fusion: FakeFusion) -> list[str]:
    return [message["step"] for message in fusion.palette.seen]


def test_one_press_saves_sends_shows_and_opens_the_page(start, tmp_path, opened):
    with local_service() as service:
        fusion = start(design(), service.url, KEY)
        fusion.press(EXPORT)
        fusion.palette.say("ready")
        fusion.deliver(until=lambda: "done" in steps(fusion))
        assert len(service.folders) == 1
    assert opened == [f"{service.url}/ui/mechanisms/{MECHANISM}"]
    assert fusion.boxes == []
    kinds = list(dict.fromkeys(steps(fusion)))
    assert kinds == ["read", "saved", "upload", "stored", "done"]
    folder = tmp_path / "exports" / "design_v1"
    assert read_mechanism(folder / "mechanism.json").joints[0].id == "Pivot"
    assert json.loads((folder / "raw" / "snapshot.json").read_text(encoding="utf-8"))["document"]["name"] == "design v1"


def test_without_a_service_the_files_are_saved_and_that_is_all(start, tmp_path, opened):
    fusion = start(design())
    fusion.press(EXPORT)
    fusion.palette.say("ready")
    assert steps(fusion)[-1] == "done"
    assert fusion.palette.seen[-1]["text"] == f"Saved in {tmp_path / 'exports' / 'design_v1'}."
    assert opened == []
    fusion.palette.say("folder")
    assert opened == [(tmp_path / "exports" / "design_v1").as_uri()]


def test_a_second_press_makes_a_second_folder(start, tmp_path):
    fusion = start(design())
    for _ in range(2):
        fusion.press(EXPORT)
    assert sorted(path.name for path in (tmp_path / "exports").iterdir()) == ["design_v1", "design_v1-2"]


def test_what_cannot_move_is_told_with_its_remedy_and_kept(start, tmp_path, opened):
    loose = design()
    loose.rootComponent.allOccurrences.item(0).isGrounded = False
    fusion = start(loose, "http://127.0.0.1:9")
    fusion.press(EXPORT)
    fusion.palette.say("ready")
    saved = next(message for message in fusion.palette.seen if message["step"] == "saved")
    assert "grounded" in saved["problems"][0]
    assert steps(fusion)[-1] == "failed"
    assert (tmp_path / "exports" / "design_v1" / "raw" / "snapshot.json").is_file()
    assert opened == []


def test_messages_wait_for_a_palette_that_loads_slowly(start):
    fusion = start(design())
    fusion.press(EXPORT)
    assert fusion.palette.seen == []
    fusion.palette.say("ready")
    assert steps(fusion)[0] == "read"
    fusion.press(EXPORT)
    assert steps(fusion).count("begin") == 1, "the second export begins on an empty page"


def test_the_palette_may_be_closed_while_it_runs(start, opened):
    with local_service() as service:
        fusion = start(design(), service.url, KEY)
        fusion.press(EXPORT)
        fusion.palettes.things.clear()
        fusion.deliver(until=lambda: opened)
    assert fusion.boxes == []


def test_a_drawing_or_no_document_at_all_is_refused_kindly(start):
    fusion = start(None)
    fusion.press(EXPORT)
    assert fusion.boxes == ["Open a design first: this is another kind of document."]


def test_settings_that_cannot_be_read_are_told_before_anything_is_done(start, tmp_path):
    fusion = start(design())
    (tmp_path / "settings" / "fusion.json").write_text("{")
    fusion.press(EXPORT)
    (box,) = fusion.boxes
    assert "Correct it in LinkTwin settings." in box
    assert not (tmp_path / "exports").exists()


def test_the_settings_dialog_shows_and_stores(start):
    fusion = start(design(), "http://127.0.0.1:8000")
    args = fusion.press(SETTINGS)
    inputs = args.command.commandInputs
    assert inputs.itemById("url").value == "http://127.0.0.1:8000"
    inputs.itemById("url").value = "https://twin.example/"
    inputs.itemById("key").value = " lt_1 "
    args.command.execute.fire(args)
    assert not args.executeFailed
    settings = room("lib.settings")
    stored = settings.load(settings.settings_path())
    assert (stored.url, stored.key) == ("https://twin.example", "lt_1")


@pytest.mark.parametrize(("field", "value"), [("url", "twin"), ("simulate_s", "soon"), ("folder", "")])
def test_the_settings_dialog_refuses_and_changes_nothing(start, field, value):
    fusion = start(design())
    settings = room("lib.settings")
    before = settings.load(settings.settings_path())
    args = fusion.press(SETTINGS)
    args.command.commandInputs.itemById(field).value = value
    args.command.execute.fire(args)
    assert args.executeFailed
    assert args.executeFailedMessage.startswith("Nothing was changed: ")
    assert settings.load(settings.settings_path()) == before


def test_an_unforeseen_failure_is_shown_and_does_not_reach_fusion(start):
    fusion = start(fakes.Fake(rootComponent=RuntimeError("3 : no root")))
    fusion.press(EXPORT)
    assert "no root" in fusion.boxes[0]


def test_a_button_that_a_bad_end_left_behind_does_not_keep_the_addin_from_starting(start):
    fusion = start(design())
    importlib.import_module("LinkTwin.LinkTwin").run({})
    assert fusion.boxes == []
    assert set(fusion.controls.things) == {EXPORT, SETTINGS}


def test_a_page_asks_for_nothing_but_pages_to_be_opened(start, opened):
    fusion = start(design())
    fusion.press(EXPORT)
    fusion.palette.say("ready")
    for page in ("file:///etc/passwd", "javascript:alert(1)", None):
        fusion.palette.say("open", page=page)
    assert opened == []


def test_the_palettes_page_needs_no_network():
    page = Path(room("lib").__file__).parents[1] / "commands" / "export" / "palette.html"
    text = page.read_text(encoding="utf-8")
    assert "http" not in text
    assert "src=" not in text
    assert "innerHTML" not in text, "names of parts are text, never markup"
