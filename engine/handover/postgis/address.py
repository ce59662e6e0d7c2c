"""The address of a database, a connection to it, and what is said of its errors: never with the password."""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from ...core.errors import InputError
from ...core.messages import one_line

if TYPE_CHECKING:
    import psycopg

_WAIT_S = 10
_AROUND_REASON = re.compile(r"^connection (?:failed|is bad): |\s*Is the server running [^?]*\?")
"""What the driver says before the reason, and libpq asks after it."""
_NO_DRIVER = (
    "The package psycopg, which writes to PostgreSQL, is not installed; install it with: pip install "
    "'slopewatch[postgis]'."
)
_NO_ADDRESS = "--to is no address of a database; write it as postgresql://user@host/database."
_SCHEMES = ("postgresql://", "postgres://")


@dataclass(frozen=True)
class Database:
    """Where to: ``shown`` is the address without what is secret. The address itself is in no text of it."""

    shown: str
    address: str = field(repr=False)
    secrets: tuple[str, ...] = field(repr=False)

    def without_secrets(self, text: str) -> str:
        """``text`` in one line, with what is secret in the address replaced."""
        for secret in (self.address, *self.secrets):
            text = text.replace(secret, "...")
        return one_line(" ".join(text.split()))


def parse_address(text: str) -> Database:
    """An address as libpq reads it.

    Raises:
        InputError: it is none, or the driver is missing.
    """
    if importlib.util.find_spec("psycopg") is None:
        raise InputError(_NO_DRIVER)
    import psycopg
    from psycopg.conninfo import conninfo_to_dict

    address = text.strip()
    if not address.startswith(_SCHEMES):
        raise InputError(_NO_ADDRESS)
    try:
        parts = {name: str(value) for name, value in conninfo_to_dict(address).items() if value}
    except psycopg.Error:
        # its text repeats the address
        raise InputError(_NO_ADDRESS) from None
    secrets = tuple(parts[name] for name in ("password", "sslpassword", "oauth_client_secret") if name in parts)
    user = f"{parts['user']}@" if "user" in parts else ""
    port = f":{parts['port']}" if "port" in parts else ""
    shown = f"postgresql://{user}{parts.get('host', '')}{port}/{parts.get('dbname', '')}"
    quoted = tuple(quote(secret, safe="") for secret in secrets)
    return Database(one_line(shown), address, tuple(dict.fromkeys((*secrets, *quoted))))


@contextmanager
def transaction(database: Database) -> Iterator[psycopg.Connection]:
    """A connection with one transaction, which is kept if the block ends well, else undone.

    Raises:
        InputError: the database cannot be reached, does not let in, is read-only, or refuses something.
    """
    import psycopg
    from psycopg.conninfo import conninfo_to_dict, make_conninfo

    given = conninfo_to_dict(database.address)
    own: dict[str, Any] = {"application_name": "slopewatch", "connect_timeout": _WAIT_S, "client_encoding": "utf8"}
    try:
        connection = psycopg.connect(make_conninfo(**{**own, **given}))
    except (psycopg.Error, UnicodeError, OSError) as error:
        raise InputError(_unreached(database, str(error))) from None
    try:
        with connection:
            yield connection
    except psycopg.Error as error:
        raise InputError(_refused(database, error)) from None


def _unreached(database: Database, reason: str) -> str:
    lower = reason.lower()
    if "password" in lower:
        return (
            f"The database {database.shown} does not take the user's password, or was given none; put it into the "
            "address, PGPASSWORD or ~/.pgpass."
        )
    return (
        f"The database {database.shown} cannot be reached ({_bare(database.without_secrets(reason))}); check the "
        "address, and that it runs."
    )


def _bare(reason: str) -> str:
    """The reason alone, such as the host, the port and "Connection refused", of what libpq says and asks."""
    return _AROUND_REASON.sub("", reason).rstrip(".")


def _refused(database: Database, error: psycopg.Error) -> str:
    import psycopg.errors

    reason = database.without_secrets(str(error.diag.message_primary or error))
    if isinstance(error, psycopg.errors.ReadOnlySqlTransaction):
        return f"The database {database.shown} is read-only, so nothing was handed over; give one that can be written."
    if isinstance(error, psycopg.errors.InsufficientPrivilege):
        return (
            f"The user of {database.shown} lacks a right ({reason}), so nothing was handed over; have the "
            "administrator grant it."
        )
    if isinstance(error, psycopg.OperationalError):
        return f"The connection to {database.shown} ended ({reason}), so nothing was handed over; try again."
    return f"The database {database.shown} refused the hand-over ({reason}); nothing was handed over."
