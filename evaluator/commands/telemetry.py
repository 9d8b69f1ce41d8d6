# The optional library is not in the environment in which types are checked.
# pyright: reportMissingImports=false, reportUnknownVariableType=false, reportUnknownMemberType=false
"""`--otel`: exports the spans of a run to an OpenTelemetry collector."""

import contextlib
from collections.abc import Generator
from importlib import import_module
from importlib.metadata import version
from importlib.util import find_spec

from opentelemetry.trace import set_tracer_provider

from evaluator.errors import UsageError

EXTRA = "physment-mcp[otel]"


def require_otel() -> None:
    """Check that the exporter is installed, without importing it.

    Raises:
        UsageError: The exporter is not installed.
    """
    names = ("opentelemetry.sdk", "opentelemetry.exporter.otlp.proto.http")
    try:
        found = all(find_spec(name) is not None for name in names)
    except ModuleNotFoundError:
        found = False
    if not found:
        raise UsageError(
            f"--otel needs the SDK and the exporter of OpenTelemetry, which are not installed: pip install '{EXTRA}'"
        )


@contextlib.contextmanager
def exporting_spans() -> Generator[None]:
    """Export spans while the context is open; flush them when it closes.

    The `OTEL_…` environment variables of OpenTelemetry configure endpoint, headers and sampling.
    """
    require_otel()
    sdk, export = import_module("opentelemetry.sdk.trace"), import_module("opentelemetry.sdk.trace.export")
    resource = import_module("opentelemetry.sdk.resources").Resource
    exporter = import_module("opentelemetry.exporter.otlp.proto.http.trace_exporter").OTLPSpanExporter
    described = resource.create({"service.name": "physment-eval", "service.version": version("physment-mcp")})
    provider = sdk.TracerProvider(resource=described)
    provider.add_span_processor(export.BatchSpanProcessor(exporter()))
    set_tracer_provider(provider)
    try:
        yield
    finally:
        provider.shutdown()
