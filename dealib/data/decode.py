"""Conversion of a text file to UTF-8 with one kind of minus, space and line end."""

from __future__ import annotations

import codecs
import re
from pathlib import Path

from dealib.errors import ConfigError

LARGEST = 1 << 30  # bytes of a file

_MARKS = {  # what a file begins with -> its encoding
    codecs.BOM_UTF8: "utf-8-sig", codecs.BOM_UTF32_LE: "utf-32", codecs.BOM_UTF32_BE: "utf-32",
    codecs.BOM_UTF16_LE: "utf-16", codecs.BOM_UTF16_BE: "utf-16",
}  # fmt: skip
# characters that headers have; general guessers take the one byte of a lone 'µ' for Chinese
_WESTERN = "A-Za-z\x00-\x7f°µμ²³·±ΩÀ-ÖØ-öø-ÿœŒ–—’‘“”€"
_EASTERN = "\x00-\x7f\u3000-\u30ff\u4e00-\u9fff\uff00-\uffef°μΩ℃・"
_LIKELY = {
    "cp1252": re.compile(rf"(?!.*\bæ[mFsNAVC]\b)[{_WESTERN}]*", re.DOTALL),
    "gb18030": re.compile(rf"[{_EASTERN}]*", re.DOTALL),
    "cp850": re.compile("[\x00-\x7fäöüÄÖÜßéèêàçñµ°²³±·]*", re.DOTALL),
    "shift_jis": re.compile(rf"[{_EASTERN}]*", re.DOTALL),
}
_DIGITS = rb"(?<=\d)(?:\xc2\xa0|\xe2\x80[\xaf\x89\x88\x99]|')(?=\d{3}(?!\d))"  # 1'000, thin blanks


def load(path: Path) -> bytes:
    """The content of a file.

    Raises:
        ConfigError: If it cannot be read, is empty, too large or no file.
    """
    try:
        if not path.is_file():
            problem = "a folder" if path.is_dir() else "no file"
            raise ConfigError(f"{path}: {problem if path.exists() else 'there is no such file'}")
        if path.stat().st_size > LARGEST:
            raise ConfigError(f"{path}: larger than {LARGEST >> 30} GB; split it")
        data = path.read_bytes()
    except OSError as error:
        raise ConfigError(f"{path}: cannot read the data: {error.strerror}") from None
    if not data.strip(b"\0 \r\n\t"):
        raise ConfigError(f"{path}: the file is empty")
    return data


def as_utf8(path: Path, data: bytes, encoding: str | None) -> tuple[bytes, list[str]]:
    """Text as UTF-8, and notes on how it was read.

    Args:
        path: The file, for messages.
        data: Content of the file.
        encoding: The user's encoding; None to guess it from byte order marks, zero bytes and
            characters that are likely in headers.

    Raises:
        ConfigError: If it is no text, or not in that encoding.
    """
    name = encoding or _encoding(path, data)
    try:
        text = data.decode(name)
    except LookupError:
        raise ConfigError(
            f"{path}: unknown encoding {name!r}; known are, for example, utf-8 and cp1252"
        ) from None
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: not in {name}: {error.reason} at {error.start}") from None
    shown = {"utf-8-sig": "UTF-8", "cp1252": "Windows-1252 (Latin-1)"}.get(name, name.upper())
    data = data if name == "utf-8" else text.encode()
    for end in (b"\r\r\n", b"\r\n", b"\r"):
        data = data.replace(end, b"\n")
    data = data.rstrip(b"\0\x1a")
    notes = [shown]
    if not data.isascii():
        for minus in ("−", "–", "‐", "‑", "﹣", "－"):
            data = re.sub(minus.encode() + rb"(?=\.?\d)", b"-", data)
    fewer = data if data.isascii() and b"'" not in data else re.sub(_DIGITS, b"", data)
    if len(fewer) < len(data):
        notes.append("thousands marks taken out")
    return fewer.replace(b"\xc2\xa0", b" "), notes


def _encoding(path: Path, data: bytes) -> str:
    for mark, name in _MARKS.items():
        if data.startswith(mark):
            return name
    head = data[:4096].rstrip(b"\0")
    zeros = [head[k::2].count(0) for k in (0, 1)]
    if max(zeros) > len(head) / 4 and min(zeros) < max(zeros) / 10:
        return "utf-16-be" if zeros[0] > zeros[1] else "utf-16-le"
    if sum(zeros) or re.search(rb"[\x01-\x06\x0e-\x19]", head):
        raise ConfigError(
            f"{path}: a binary file; export it as text, as a spreadsheet (XLSX, XLS, ODS) or as a "
            "MAT file"
        )
    try:
        data.decode("utf-8")
    except UnicodeDecodeError:
        lines = {line for line in data.splitlines() if not line.isascii()}
        return _legacy(b"\n".join(sorted(lines)[:1000]))
    return "utf-8"


def _legacy(data: bytes) -> str:
    """The 8-bit or East Asian encoding in which headers are likely; else Windows-1252, Latin-1."""
    for name, likely in _LIKELY.items():
        try:
            text = data.decode("gb2312" if name == "gb18030" else name)
        except UnicodeDecodeError:
            continue
        if likely.fullmatch(text):
            return name
    return "cp1252" if not re.search(rb"[\x81\x8d\x8f\x90\x9d]", data) else "latin-1"
