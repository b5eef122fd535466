"""Files in an object store that is asked over HTTP in S3's own words; records and queue stay in the data folder."""

import os
import signal
import subprocess
import sys
import uuid

import httpx
import pytest

from backend.service.storage import BLOCK, Storage
from tests.service.asked import refused
from tests.service.bucket import BUCKET, bucket
from tests.service.clips import clip
from tests.service.serving import ROOT, serving, settings_in


@pytest.fixture(scope="module")
def url():
    with bucket() as found:
        yield found


@pytest.fixture(scope="module")
def served(url, tmp_path_factory):
    folder = tmp_path_factory.mktemp("served")
    with serving(folder, settings_in(folder, storage_url=f"{url}/served", workers=1)) as running:
        yield running
        assert "Traceback" not in running.log.read_text(), running.log.read_text()


def test_files_are_kept_whole_in_parts_and_apart_from_what_else_lies_there(url, tmp_path):
    here, beside = Storage(f"{url}/here/"), Storage(f"{url}/here-too")
    source = tmp_path / "source"
    source.write_bytes(os.urandom(2 * BLOCK + 1000))  # sent in parts
    kept, other = here.put(source), beside.put(source)
    assert here.read(kept.key) == source.read_bytes()
    assert b"".join(here.chunks(kept.key, BLOCK - 5, BLOCK + 7)) == source.read_bytes()[BLOCK - 5 : BLOCK + 7]
    here.bring(kept.key, tmp_path / "brought" / "there")
    assert (tmp_path / "brought" / "there").read_bytes() == source.read_bytes()
    assert [key for key, written in here.written() if written > source.stat().st_mtime - 60] == [kept.key]
    assert here.owner() is None
    here.belong_to("one database")
    assert here.owner() == "one database"
    here.drop(kept.key)
    here.drop(kept.key)
    assert list(here.written()) == []
    with pytest.raises(FileNotFoundError):
        here.read(kept.key)
    with pytest.raises(FileNotFoundError):
        next(here.chunks(kept.key))
    assert beside.read(other.key) == source.read_bytes()


def test_what_another_process_writes_after_a_look_round_is_found(url, tmp_path):
    storage = Storage(f"{url}/shared")
    (tmp_path / "source").write_bytes(b"first")
    kept = storage.put(tmp_path / "source")
    assert len(list(storage.written())) == 1
    theirs = kept.key[:2] + str(uuid.uuid4())[2:]  # beside ours
    code = "import sys, s3fs; s3fs.S3FileSystem().pipe_file(sys.argv[1], b'second')"
    subprocess.run([sys.executable, "-c", code, storage._place(theirs)], check=True, timeout=120)
    assert b"".join(storage.chunks(theirs)) == b"second"


def test_the_service_keeps_hands_out_and_drops_its_files_there(served, url):
    there, client = Storage(f"{url}/served"), served.client
    drawing, film = served.store(), clip(3 * 2**20)
    video = client.put("/api/v1/videos?name=e1", content=film)
    assert video.status_code == 201, video.text
    place = video.json()["files"][0]["url"]
    assert client.get(place).content == film
    for asked, part in (("bytes=0-99", film[:100]), ("bytes=3000000-", film[3_000_000:]), ("bytes=-10", film[-10:])):
        answer = client.get(place, headers={"Range": asked})
        assert (answer.status_code, answer.content) == (206, part)
    refused(client.get(place, headers={"Range": f"bytes={len(film)}-"}), 416, "no-such-part")
    id = served.start(drawing, duration_s=0.1)
    assert served.finished(id)["state"] == "succeeded"
    result = client.get(f"/api/v1/jobs/{id}/result").json()
    assert result["report"] == {"mechanism": "fourbar"}
    for file in result["files"]:
        assert len(client.get(file["url"]).content) == file["bytes"]
    assert len(list(there.written())) == 2 + len(result["files"])
    assert not (served.folder / "data" / "files").exists()
    assert client.delete(f"/api/v1/jobs/{id}?forget=true").status_code == 200
    for thing in (f"/api/v1/mechanisms/{drawing}", f"/api/v1/videos/{video.json()['id']}"):
        assert client.delete(thing).status_code == 204
    assert list(there.written()) == []


def test_a_killed_worker_loses_no_job_whose_files_lie_there(served, url):
    drawing = served.store()
    id = served.start(drawing, duration_s=3.0, threshold=0.75)
    served.running(id)
    (worker,) = served.processes("backend.service.jobs")
    os.kill(worker, signal.SIGKILL)
    job = served.finished(id)
    assert (job["state"], job["attempt"]) == ("succeeded", 2), job
    assert (served.ledger("start", id), served.ledger("end", id)) == (2, 1)
    files = served.client.get(f"/api/v1/jobs/{id}/files").json()
    assert {file["path"] for file in files} == {"inner/motion.csv", "report.json"}
    kept = {key for key, _ in Storage(f"{url}/served").written()}
    assert len(kept) == 1 + len(files)  # and nothing of the attempt that died


def test_a_bucket_that_is_none_and_a_key_that_opens_nothing_are_told_before_anything_starts(url, tmp_path):
    begun = httpx.post(f"{os.environ['AWS_ENDPOINT_URL']}/moto-api/reset-auth", content="1")  # then keys are looked at
    assert begun.status_code == 200
    try:
        said = refused_to_serve(url.replace(BUCKET, "nowhere"), tmp_path)
        assert "nothing can be kept in the storage s3://nowhere/linktwin: The specified bucket does not exist" in said
        said = refused_to_serve(url, tmp_path)
        assert f"nothing can be kept in the storage {url}" in said
        assert "AWS_ACCESS_KEY_ID" in said
    finally:
        httpx.post(f"{os.environ['AWS_ENDPOINT_URL']}/moto-api/reset-auth", content="inf")


def refused_to_serve(url: str, folder) -> str:
    """What `linktwin serve` says as it ends."""
    environment = {**os.environ, "LINKTWIN_STORAGE_URL": url, "PYTHONPATH": str(ROOT)}
    code = "from backend.cli import main; main()"
    command = [sys.executable, "-c", code, "serve", "--port", "0", "--data", str(folder)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, env=environment)
    assert done.returncode == 2, done.stderr
    assert "Traceback" not in done.stderr
    return done.stderr
