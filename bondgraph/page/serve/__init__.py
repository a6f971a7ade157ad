"""The page of a model live: a server for this machine alone, which follows the file and runs what sliders ask for."""

from __future__ import annotations

from .server import Server
from .session import Session

__all__ = ["Server", "Session"]
