"""Access control of the server: it answers only its own pages, at its own address, with the token that it gave them.

A foreign page open in the same browser can send requests to this machine. It cannot read the token, its `Origin` differs, and if its own name
resolves to this machine (DNS rebinding), the `Host` is that name.
"""

from __future__ import annotations

import ipaddress
import secrets
from collections.abc import Mapping
from dataclasses import dataclass, field

LOOPBACK = ("127.0.0.1", "localhost", "[::1]")


@dataclass(frozen=True)
class Guard:
    """Address `host` and `port` of the server; `token` is new in each server."""

    host: str
    port: int
    token: str = field(default_factory=lambda: secrets.token_urlsafe(24))

    @property
    def address(self) -> str:
        """Address of the page, with the token."""
        name = f"[{self.host}]" if ":" in self.host else self.host
        return f"http://{name}:{self.port}/?token={self.token}"

    def refusal(self, headers: Mapping[str, str], token: str) -> str:
        """Return the reason for refusing a request; empty if it is accepted."""
        host = headers.get("Host", "")
        if not self._is_ours(host):
            return "this server does not answer to that name"
        origin = headers.get("Origin")
        if origin is not None and origin != f"http://{host}":
            return "a page from elsewhere asks nothing of this server"
        if headers.get("Sec-Fetch-Site", "none") not in ("none", "same-origin"):
            return "a page from elsewhere asks nothing of this server"
        if not secrets.compare_digest(token.encode("utf-8", "replace"), self.token.encode()):
            return "the address of the page has a token in it, which is missing here or is another's"
        return ""

    def _is_ours(self, host: str) -> bool:
        name, colon, port = host.rpartition(":")
        if not colon or port != str(self.port):
            return False
        if name in LOOPBACK or name.strip("[]") == self.host:
            return True
        listens_to_all = _is_number(self.host) and ipaddress.ip_address(self.host).is_unspecified
        return listens_to_all and _is_number(name.strip("[]"))  # a stranger's name is no number


def _is_number(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True
