"""Live page of a model: a server for this machine only, which follows the file and makes the runs that sliders request."""

from .server import Server
from .session import Session

__all__ = ["Server", "Session"]
