# The optional library is not in the environment in which types are checked.
# pyright: reportMissingImports=false
"""Tests of spans: their tree and attributes, and that they contain no information that records lack."""

import json
import os
import subprocess
import sys
import threading
from collections.abc import Generator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from evaluator.commands.program import main
from evaluator.store.run_folder import RunFolder

EXPORTER = find_spec("opentelemetry.exporter") is not None and find_spec("opentelemetry.sdk") is not None
needs_otel = pytest.mark.skipif(not EXPORTER, reason="the extra `otel` is not installed")


@contextmanager
def collecting() -> Generator[tuple[str, list[Any]]]:
    """Start a collector in this process; yields its address, and the decoded requests that it received."""
    from opentelemetry.proto.collector.trace.v1.trace_service_pb2 import ExportTraceServiceRequest

    received: list[Any] = []

    class Collector(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            import gzip

            body = self.rfile.read(int(self.headers["Content-Length"]))
            if self.headers.get("Content-Encoding") == "gzip":
                body = gzip.decompress(body)
            received.append(ExportTraceServiceRequest.FromString(body))
            self.send_response(200)
            self.send_header("Content-Length", "0")
            self.end_headers()

        def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - named by the base class
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Collector)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}", received
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


def spans_of(received: list[Any]) -> list[Any]:
    return [
        span
        for request in received
        for part in request.resource_spans
        for scope in part.scope_spans
        for span in scope.spans
    ]


def attributes(span: Any) -> dict[str, Any]:
    return {one.key: getattr(one.value, one.value.WhichOneof("value")) for one in span.attributes}


def exported(tmp_path: Path, words: list[str], **variables: str) -> tuple[subprocess.CompletedProcess[str], list[Any]]:
    """Run a program in its own process, because a tracer provider can be set only once per process."""
    with collecting() as (url, received):
        environment = {**os.environ, "OTEL_EXPORTER_OTLP_ENDPOINT": url, **variables}
        command = [sys.executable, "-m", "evaluator", "run", "--otel", *words, "--out", str(tmp_path / "run")]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    return done, received


@needs_otel
def test_an_episode_is_a_tree_of_spans_with_the_conventional_names(tmp_path: Path, host_url: str) -> None:
    script = tmp_path / "turns.json"
    turns = [
        [{"tool": "step", "arguments": {"duration": 0.1}}],
        [{"tool": "get_velocity", "arguments": {"object_id": "nothing"}}],
    ]
    turns += [[{"tool": "answer", "arguments": {"answer": 31.4159}}]]
    script.write_text(json.dumps(turns), encoding="utf-8")
    done, received = exported(tmp_path, ["--agent", f"scripted:{script}", "--scenes", "7", "--server", host_url])
    assert done.returncode == 0, done.stderr
    spans = spans_of(received)
    by_id = {span.span_id: span for span in spans}
    [episode] = [span for span in spans if span.name.startswith("invoke_agent ")]
    [record] = RunFolder(tmp_path / "run").episodes().values()
    told = attributes(episode)
    assert told["gen_ai.operation.name"] == "invoke_agent"
    assert told["gen_ai.agent.name"] == record.key.agent
    assert (told["physment.scene"], told["physment.outcome"], told["physment.turns"]) == (7, "answered", 3)
    calls = [span for span in spans if span.name.startswith("execute_tool ")]
    assert [span.name for span in calls] == ["execute_tool step", "execute_tool get_velocity", "execute_tool answer"]
    for span in calls:
        assert attributes(span)["gen_ai.tool.name"] == span.name.removeprefix("execute_tool ")
        assert attributes(span)["mcp.method.name"] == "tools/call"
        parent = by_id[span.parent_span_id]
        assert parent.name == "turn"
        assert by_id[parent.parent_span_id] is episode
    assert ["error.type" in attributes(span) for span in calls] == [False, True, False]
    requests = [span for span in spans if span.name.startswith("MCP send tools/call")]
    assert {by_id[span.parent_span_id].name for span in requests} == {span.name for span in calls}
    assert "31.4159" not in str(received)
    assert record.prompt.splitlines()[0] not in str(received)


@needs_otel
def test_a_request_to_a_model_has_a_span_without_its_content_and_without_keys(tmp_path: Path, host_url: str) -> None:
    """The provider quotes the key in its error message, which neither records nor spans may contain."""
    key = "sk-canary-0123456789"

    class Refusing(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            body = json.dumps({"error": {"message": f"the key {key} may not ask this", "code": "bad"}}).encode()
            self.send_response(400)
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - named by the base class
            pass

    provider = ThreadingHTTPServer(("127.0.0.1", 0), Refusing)
    threading.Thread(target=provider.serve_forever, daemon=True).start()
    try:
        words = ["--agent", "model:openai:gpt-5.5", "--base-url", f"http://127.0.0.1:{provider.server_port}/v1"]
        _, received = exported(
            tmp_path, [*words, "--scenes", "7", "--budgets", "2", "--server", host_url], OPENAI_API_KEY=key
        )
    finally:
        provider.shutdown()
        provider.server_close()
    spans = spans_of(received)
    chats = [span for span in spans if attributes(span).get("gen_ai.operation.name") == "chat"]
    assert chats
    assert all(attributes(span)["gen_ai.request.model"] == "gpt-5.5" for span in chats)
    assert "canary" not in str(received)
    assert "may not ask this" not in str(received)
    assert "Scene: Speed of a dropped ball" not in str(received)


def test_a_missing_extra_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    if EXPORTER:
        pytest.skip("the extra `otel` is installed here")
    assert main(["run", "--otel", "--scenes", "7", "--out", str(tmp_path / "run")]) == 2
    assert "pip install 'physment-mcp[otel]'" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


def test_ray_workers_export_no_spans(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "--otel", "--executor", "ray", "--scenes", "7"]) == 2
    assert "the workers of --executor ray export no spans" in capsys.readouterr().err


def test_an_evaluation_without_the_option_exports_nothing(host_url: str, tmp_path: Path) -> None:
    from opentelemetry import trace

    provider = trace.get_tracer_provider()
    assert main(["run", "--agent", "blind", "--scenes", "7", "--server", host_url, "--out", str(tmp_path / "run")]) == 0
    assert trace.get_tracer_provider() is provider
