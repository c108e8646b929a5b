"""The pictures that open pages show, served by a route of their own."""

from collections import OrderedDict
from zlib import crc32

from starlette.responses import Response

ROUTE = "/pictures"
KEPT = 12
"""Pictures of a page that are kept: the three of the newest answer, and of those before, which a browser may still fetch."""


class Gallery:
    """The newest pictures of each page."""

    def __init__(self) -> None:
        self._files: dict[str, OrderedDict[str, bytes]] = {}

    def put(self, page: str, name: str, file: bytes) -> str:
        """Keeps a JPEG; its address, which differs when the picture does."""
        files = self._files.setdefault(page, OrderedDict())
        key = f"{name}-{crc32(file):08x}"
        files[key] = file
        files.move_to_end(key)
        while len(files) > KEPT:
            files.popitem(last=False)
        return f"{ROUTE}/{page}/{key}"

    def get(self, page: str, key: str) -> Response:
        """What the route answers."""
        files = self._files.get(page)
        if files is None or key not in files:
            return Response(status_code=404)
        return Response(files[key], media_type="image/jpeg", headers={"Cache-Control": "no-store"})

    def drop(self, page: str) -> None:
        """Forgets a page that was closed."""
        self._files.pop(page, None)
