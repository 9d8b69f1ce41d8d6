"""Redacts secrets: values of secret environment variables and tokens, also in escaped and encoded forms."""

import base64
import json
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar, cast
from urllib.parse import quote, quote_plus

from pydantic import BaseModel

R = TypeVar("R", bound=BaseModel)

_SECRET_NAME = re.compile(r"KEY|TOKEN|SECRET|PASSWORD|PASSWD|CREDENTIAL", re.IGNORECASE)
_SHORTEST = 8
"""Shortest value that is redacted, in characters. Shorter values would match ordinary text."""


@dataclass(frozen=True, slots=True)
class Redaction:
    """Secrets and the names that replace them."""

    forms: Mapping[str, str] = field(default_factory=dict[str, str])
    """Form of a secret → the secret's name. The longest form is first, because a secret may contain another one."""

    @classmethod
    def of(cls, environment: Mapping[str, str], tokens: Mapping[str, str] | None = None) -> "Redaction":
        """Collect the secrets of an environment, recognised by the names of the variables, and further secrets.

        Args:
            environment: Environment variable → value.
            tokens: Name → value of further secrets.
        """
        secrets = {value: name for name, value in environment.items() if _SECRET_NAME.search(name)}
        secrets |= {value: name for name, value in (tokens or {}).items()}
        forms = {form: name for value, name in secrets.items() if len(value) >= _SHORTEST for form in _forms(value)}
        return cls({form: forms[form] for form in sorted(forms, key=len, reverse=True)})

    def text(self, text: str) -> str:
        """The text with each secret replaced by its name in brackets."""
        for form, name in self.forms.items():
            text = text.replace(form, f"[{name}]")
        return text

    def record(self, record: R) -> R:
        """The record with each secret in its texts replaced by its name in brackets."""
        if not self.forms:
            return record
        line = record.model_dump_json()
        if not any(form in line for form in self.forms):
            return record
        return type(record).model_validate(self._value(json.loads(line)))

    def _value(self, value: Any) -> Any:
        if isinstance(value, str):
            return self.text(value)
        if isinstance(value, dict):
            named = cast("dict[str, Any]", value)
            return {self.text(name): self._value(part) for name, part in named.items()}
        if isinstance(value, list):
            return [self._value(part) for part in cast("list[Any]", value)]
        return value


def _forms(secret: str) -> Iterable[str]:
    """The forms in which a secret may occur: plain, JSON-escaped, URL-encoded and base64-encoded."""
    plain = {secret, json.dumps(secret)[1:-1], json.dumps(secret, ensure_ascii=False)[1:-1]}
    escaped = {quote(secret, safe=""), quote(secret), quote_plus(secret)}
    return plain | escaped | set(_in_base64(secret.encode("utf-8", "surrogatepass")))


def _in_base64(secret: bytes) -> Iterator[str]:
    """Base64 characters of a secret that are independent of adjacent bytes, for each of the three alignments."""
    for before in range(3):
        first, after = -(-before * 8 // 6), (before + len(secret)) * 8 // 6
        for encode in (base64.b64encode, base64.urlsafe_b64encode):
            yield encode(bytes(before) + secret).decode()[first:after]
