"""The protocol as `pygls` has it, with an answer to requests that cannot be read, for which their client would wait for ever."""

from __future__ import annotations

from typing import Any

from cattrs import transform_error
from pygls.exceptions import JsonRpcException, JsonRpcInvalidParams
from pygls.protocol import LanguageServerProtocol


class AnsweringProtocol(LanguageServerProtocol):  # type: ignore[misc]
    """Protocol in which each request has an answer; the error is also told to the reader of the log."""

    def structure_message(self, data: dict[str, Any]) -> Any:
        """Return a message as an object. `json` calls this for each object within it too, which have no `id` and `method`."""
        try:
            return super().structure_message(data)
        except JsonRpcException as problem:
            if "id" in data and "method" in data:
                why = "; ".join(transform_error(problem.__cause__)) if problem.__cause__ is not None else str(problem)
                refused = JsonRpcInvalidParams(f"The parameters of {data['method']} cannot be read: {why}")
                self._send_response(data["id"], error=refused.to_response_error())
            raise
