"""The settings file: private, checked, and refused with the remedy."""

import json
import os
import stat
import sys

import pytest

from tests.plugin_fusion.addin import room

settings = room("lib.settings")


def test_what_is_stored_is_loaded_again(tmp_path):
    wanted = settings.Settings(url="https://twin.example", key="lt_1", folder=str(tmp_path), up="y", simulate_s=2.0)
    settings.store(wanted, tmp_path / "new" / "fusion.json")
    assert settings.load(tmp_path / "new" / "fusion.json") == wanted


@pytest.mark.skipif(sys.platform == "win32", reason="Windows keeps a user's folder private by other means")
def test_the_key_is_readable_by_its_user_alone(tmp_path):
    path = tmp_path / "fusion.json"
    path.write_text("{}")
    path.chmod(0o644)
    settings.store(settings.Settings(key="lt_1"), path)
    assert stat.S_IMODE(path.stat().st_mode) == 0o600


def test_without_a_file_a_service_on_this_machine_is_meant(tmp_path):
    assert settings.load(tmp_path / "none.json").url == "http://127.0.0.1:8000"


@pytest.mark.parametrize(
    ("told", "words"),
    [
        ("{", "cannot be read"),
        ("[]", "no object"),
        ('{"server": "x"}', "'server' is no setting"),
        ('{"up": 3}', "up is 3; write text"),
        ('{"up": "w"}', 'up is "w"'),
        ('{"url": "ftp://x"}', "no http:// or https:// address"),
        ('{"url": "http://x:port"}', "no http:// or https:// address"),
        ('{"url": "http://me:secret@x"}', "no http:// or https:// address"),
        ('{"url": "http://far.example", "key": "lt_1"}', "would travel unencrypted"),
        ('{"key": "lt 1"}', "the key holds a space"),
        ('{"folder": " "}', "the folder is empty"),
        ('{"simulate_s": true}', "write a number"),
        ('{"simulate_s": 1e9}', "write 0 to 3600 seconds"),
    ],
)
def test_a_setting_that_cannot_be_used_is_named_with_its_file(tmp_path, told, words):
    path = tmp_path / "fusion.json"
    path.write_text(told)
    with pytest.raises(settings.BadSettings) as caught:
        settings.load(path)
    assert words in str(caught.value)
    assert str(path) in str(caught.value)


def test_the_environment_may_name_another_file(monkeypatch, tmp_path):
    monkeypatch.setenv("LINKTWIN_FUSION_SETTINGS", str(tmp_path / "x.json"))
    assert settings.settings_path() == tmp_path / "x.json"


def test_a_store_that_fails_keeps_the_old_settings(tmp_path, monkeypatch):
    path = tmp_path / "fusion.json"
    settings.store(settings.Settings(key="lt_old"), path)

    def full(*_):
        raise OSError("disk full")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(OSError, match="disk full"):
        settings.store(settings.Settings(key="lt_new"), path)
    assert json.loads(path.read_text())["key"] == "lt_old"
