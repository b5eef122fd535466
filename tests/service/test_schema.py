"""The whole schema asked at random: nothing fails, and nothing is answered that the schema does not tell of.

LINKTWIN_SCHEMA_EXAMPLES: questions of each operation; six where nothing is said, for it is asked at every run.
"""

import os

import pytest
import schemathesis
from hypothesis import HealthCheck, Phase, given, settings, strategies
from schemathesis.checks import not_a_server_error
from schemathesis.specs.openapi.checks import (
    content_type_conformance,
    missing_required_header,
    response_headers_conformance,
    response_schema_conformance,
    status_code_conformance,
    unsupported_method,
)

from backend.service.keys import make_key
from backend.service.service import open_service
from tests.service.conftest import JSON, asking
from tests.service.serving import FOURBAR, settings_in

CHECKS = (
    not_a_server_error, status_code_conformance, content_type_conformance, response_schema_conformance,
    response_headers_conformance, missing_required_header, unsupported_method,
)  # fmt: skip
EXAMPLES = int(os.environ.get("LINKTWIN_SCHEMA_EXAMPLES", "6"))


@pytest.fixture(scope="module")
def asked(tmp_path_factory, empty_records):
    service = open_service(settings_in(tmp_path_factory.mktemp("schema"), require_keys=True))
    with asking(service) as client:
        client.headers["Authorization"] = f"Bearer {make_key(service.database, 'ada')[1]}"
        yield client


@pytest.fixture(scope="module")
def known(asked) -> dict[str, str]:
    """Ids that exist, so that random questions reach further than 404."""
    drawing = asked.post("/api/v1/mechanisms", content=FOURBAR.read_bytes(), headers=JSON).json()["id"]
    job = asked.post("/api/v1/jobs", json={"kind": "simulate", "mechanism": drawing}).json()["id"]
    asked.delete(f"/api/v1/jobs/{job}")
    return {"mechanism": drawing, "job": job}


def questions(asked) -> list:
    """Every operation of the schema that the service itself publishes."""
    loaded = schemathesis.openapi.from_dict(asked.get("/api/v1/openapi.json").json())
    loaded.config.update(base_url=str(asked.base_url).rstrip("/"))
    return [found.ok() for found in loaded.get_all_operations()]


def test_whatever_is_asked_is_answered_as_the_schema_says(asked, known):
    operations = questions(asked)
    assert len(operations) == 24
    answered = set()
    shown = {"Authorization": asked.headers["Authorization"]}
    for operation in operations:

        @given(case=operation.as_strategy(), exists=strategies.booleans())
        @settings(
            max_examples=EXAMPLES, deadline=None, derandomize=True, database=None,
            phases=[Phase.explicit, Phase.generate], suppress_health_check=list(HealthCheck),
        )  # fmt: skip
        def ask(case, exists):
            room = (case.operation.path.split("/") + [""] * 4)[3].removesuffix("s")
            if exists and room in known and "id" in case.path_parameters and case.method == "GET":
                case.path_parameters["id"] = known[room]
            response = case.call(timeout=60, headers=shown)
            answered.add(response.status_code)
            case.validate_response(response, checks=CHECKS)

        ask()
    # The questions reached what there is, what there is not, and what is faulty.
    assert {200, 404, 422} <= answered
