"""What can go wrong in a set-up, each as one sentence with its remedy."""

from __future__ import annotations

import errno
import re
from collections.abc import Sequence
from pathlib import PurePath


class SetupError(Exception):
    """The set-up could not be done; the message is one sentence for the user. Nothing half-built is left."""


class SetupCancelledError(SetupError):
    """The user cancelled."""


class NoWheelError(SetupError):
    """There is no ready build of a package for this system and this Python."""


CANCELLED = "Cancelled; the engine is as it was before, and what was downloaded is kept for the next time."
_AGAIN = "set the engine up again (what was downloaded is kept)"
_FULL = (
    "The disk of {folder} is full; make room for {space}, or name another folder under Settings > Options > "
    "SlopeWatch, and set the engine up again (what was downloaded is kept)."
)
_PROXY = (
    "The proxy does not let the set-up through; correct it in QGIS under Settings > Options > Network or in "
    f"HTTPS_PROXY, and {_AGAIN}."
)
_SOCKS = (
    "pip cannot use a SOCKS proxy; name an HTTP proxy in QGIS under Settings > Options > Network or in HTTPS_PROXY."
)
_CERTIFICATE = (
    "The certificate of the package index is not trusted on this machine; where a proxy reads the traffic, name the "
    f"file of its certificate in the environment variable PIP_CERT, and {_AGAIN}."
)
_OTHER_FILE = (
    "A downloaded file is not the one that this version of SlopeWatch was tested with, so it was refused; set the "
    "engine up again, and if that does not help ask whoever runs your package index."
)
_NO_NETWORK = (
    "The package index cannot be reached; check the network, or the proxy in QGIS under Settings > Options > Network, "
    f"and {_AGAIN}."
)
_BROKEN_OFF = f"The download broke off; {_AGAIN}."
_LOCKED = (
    "The set-up may not write to {folder}; give yourself the right to, or name another folder under Settings > Options "
    "> SlopeWatch."
)
_OTHER_FOLDER = (
    "The set-up cannot work in {folder} ({error}); name another folder under Settings > Options > SlopeWatch."
)

# What pip, urllib3 and the system write, the first that is found counts. Numbers, as the system's texts are translated.
_SIGNS = (
    (re.compile(r"No space left on device|Errno 28\b|WinError 112\b|Disk quota exceeded|Errno 122\b"), _FULL),
    (re.compile(r"ProxyError|Cannot connect to proxy|Tunnel connection failed|Proxy Authentication"), _PROXY),
    (re.compile(r"Missing dependencies for SOCKS"), _SOCKS),
    (re.compile(r"CERTIFICATE_VERIFY_FAILED|SSLCertVerificationError"), _CERTIFICATE),
    (re.compile(r"DO NOT MATCH THE HASHES|Expected sha256"), _OTHER_FILE),
    (
        re.compile(
            r"NewConnectionError|NameResolutionError|getaddrinfo failed|[Nn]ame resolution|Name or service not known"
            r"|Network is unreachable|Connection refused|ConnectTimeoutError|No route to host|Max retries exceeded"
        ),
        _NO_NETWORK,
    ),
    (
        re.compile(
            r"IncompleteRead|IncompleteDownload|ReadTimeoutError|Connection broken|Connection aborted|ProtocolError"
            r"|RemoteDisconnected|timed out|Download failed"
        ),
        _BROKEN_OFF,
    ),
    (
        re.compile(
            r"Permission denied|Errno 13\b|WinError 5\b|Read-only file system|Errno 30\b|Operation not permitted"
        ),
        _LOCKED,
    ),
)
_NO_WHEEL = re.compile(r"No matching distribution found for|Could not find a version that satisfies")
_FULL_NUMBERS = (errno.ENOSPC, getattr(errno, "EDQUOT", errno.ENOSPC))
_LOCKED_NUMBERS = (errno.EACCES, errno.EPERM, errno.EROFS)


def of_output(lines: Sequence[str], task: str, folder: PurePath, space: str) -> SetupError:
    """The error for a child of the set-up that failed, from what it wrote.

    Args:
        task: what it did, as a sentence begins: "Downloading numpy 2.4.6". space: what the set-up needs, in words.
    """
    text = "\n".join(lines)
    for signs, sentence in _SIGNS:
        if signs.search(text):
            return SetupError(sentence.format(folder=folder, space=space))
    if _NO_WHEEL.search(text):
        return NoWheelError(f"{task} failed: there is no ready build of it for this system and this Python.")
    said = [line.strip() for line in lines if line.strip() and not line.startswith(("WARNING", "[notice]"))]
    last = next((line for line in reversed(said) if line.startswith("ERROR")), said[-1] if said else "no message")
    return SetupError(f"{task} failed ({last[:300]}); the log is set-up.log in {folder}.")


def of_system(error: OSError, folder: PurePath, space: str) -> SetupError:
    """The error for a call of the system that failed in the data folder."""
    number = getattr(error, "winerror", None)
    if error.errno in _FULL_NUMBERS or number == 112:
        return SetupError(_FULL.format(folder=folder, space=space))
    if error.errno in _LOCKED_NUMBERS or number == 5:
        return SetupError(_LOCKED.format(folder=folder))
    return SetupError(_OTHER_FOLDER.format(folder=folder, error=error))
