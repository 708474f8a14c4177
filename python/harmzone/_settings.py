"""Settings as text: keys with dots, values in TOML."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping


def plain(value: object) -> object:
    """The Python value of a scalar or an array of numpy or PyTorch; anything else as it is."""
    return value.tolist() if hasattr(value, "tolist") else value


def by_dotted_key(settings: Mapping[str, object], within: str = "") -> Iterator[tuple[str, object]]:
    """`{"ttc": {"horizon_s": 3}}` as `("ttc.horizon_s", 3)`."""
    for key, value in settings.items():
        if isinstance(value, Mapping):
            yield from by_dotted_key(value, f"{within}{key}.")
        else:
            yield f"{within}{key}", value


def toml(key: str, value: object) -> str:
    """A value in TOML; `key` is for the error.

    Raises:
        TypeError: TOML has no such value.

    """
    value = plain(value)
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int):
        return str(int(value))
    if isinstance(value, float):
        # Python writes inf, -inf, nan and exponents as TOML does.
        return float.__repr__(value)
    if isinstance(value, str):
        # JSON's text is TOML's, but that TOML takes no surrogates and no bare DEL.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, list | tuple):
        return f"[{', '.join(toml(key, part) for part in value)}]"
    raise TypeError(
        f"the setting `{key}` has {value!r}, of type `{type(value).__name__}`; valid are numbers, True and "
        "False, text, lists of these, and dictionaries of settings"
    )
