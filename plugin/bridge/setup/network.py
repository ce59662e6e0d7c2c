"""How pip reaches its index: QGIS's proxy, or that of the environment, and the user's own configuration of pip."""

from __future__ import annotations

import re
from collections.abc import Mapping
from urllib.parse import quote

# Would install to another place, leave out ready builds, or not install at all.
_UNWANTED = ("PIP_TARGET", "PIP_PREFIX", "PIP_ROOT", "PIP_DRY_RUN", "PIP_NO_BINARY", "PIP_CONSTRAINT", "PIP_REPORT")


def proxy_variables(settings: Mapping[str, str]) -> dict[str, str]:
    """The environment variables of a proxy, from QGIS's settings ``proxy/*``; none where QGIS uses none of its own.

    Args:
        settings: enabled ("true"), type, host, port, user, password, noProxyUrls (one a line) or excludedUrls.
    """
    host = settings.get("host", "").strip()
    if settings.get("enabled", "").lower() != "true" or not host:
        return {}
    kind = settings.get("type", "HttpProxy")
    if kind not in ("HttpProxy", "HttpCachingProxy", "Socks5Proxy"):  # DefaultProxy: that of the system
        return {}
    user, password = (quote(settings.get(name, ""), safe="") for name in ("user", "password"))
    login = f"{user}:{password}@" if password else f"{user}@" if user else ""
    port = settings.get("port", "").strip()
    address = ("socks5h" if kind == "Socks5Proxy" else "http") + f"://{login}{host}" + (f":{port}" if port else "")
    found = {"HTTP_PROXY": address, "HTTPS_PROXY": address}
    excluded = [re.sub(r"^[a-z]+://|/.*$", "", line.strip()) for line in settings.get("noProxyUrls", "").splitlines()]
    if any(excluded):
        found["NO_PROXY"] = ",".join(part for part in excluded if part)
    return found


def pip_environment(base: Mapping[str, str], proxy: Mapping[str, str]) -> dict[str, str]:
    """The environment of pip: the user's own, with what the set-up needs; QGIS's proxy instead of another.

    Args:
        base: the cleaned environment of the engine. proxy: of ``proxy_variables``.
    """
    replaced = {name.upper() for name in proxy}
    kept = {k: v for k, v in base.items() if k.upper() not in _UNWANTED and k.upper() not in replaced}
    kept.update(proxy)
    kept.update(PIP_DISABLE_PIP_VERSION_CHECK="1", PIP_NO_INPUT="1", PIP_USER="0", PIP_REQUIRE_VIRTUALENV="0")
    kept["PIP_RETRIES"] = "3"  # without any pip does not say that it could not reach its index
    kept.setdefault("PIP_DEFAULT_TIMEOUT", "30")
    return kept


def without_passwords(line: str) -> str:
    """``line`` for a log: addresses without the password in them."""
    return re.sub(r"(://[^/\s:@]*:)[^/\s@]+@", r"\1***@", line)
