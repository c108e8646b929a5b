"""The pictures that open pages show, served by a route of their own."""

from zlib import crc32

from starlette.responses import Response

ROUTE = "/pictures"


class Gallery:
    """The newest picture of each name of each page."""

    def __init__(self) -> None:
        self._files: dict[str, dict[str, bytes]] = {}

    def put(self, page: str, name: str, file: bytes) -> str:
        """Keeps a JPEG; its address, which differs when the picture does."""
        self._files.setdefault(page, {})[name] = file
        return f"{ROUTE}/{page}/{name}?{crc32(file):08x}"

    def get(self, page: str, name: str) -> Response:
        """What the route answers."""
        file = self._files.get(page, {}).get(name)
        if file is None:
            return Response(status_code=404)
        return Response(file, media_type="image/jpeg", headers={"Cache-Control": "no-store"})

    def drop(self, page: str) -> None:
        """Forgets a page that was closed."""
        self._files.pop(page, None)
