"""The server of the page: on this machine only, unless asked; one thread for network and generator."""

from contextlib import suppress
from pathlib import Path

from nicegui import app, ui
from nicegui.client import Client
from starlette.requests import Request
from starlette.responses import Response

from fusion_lab.engine.answers import Lab
from fusion_lab.engine.state import from_query
from fusion_lab.engine.worker import NewestWins
from fusion_lab.page.address import has_screen
from fusion_lab.page.gallery import ROUTE, Gallery
from fusion_lab.page.page import Page

STYLE = Path(__file__).with_name("style.css")


def serve(lab: Lab, *, host: str, port: int, show: bool) -> None:
    """Serves pages until it is interrupted. ``show``: a browser is opened, if there is one."""
    gallery = Gallery()
    worker = NewestWins()

    @ui.page("/", title="Failure lab")
    def page(client: Client, request: Request) -> None:
        ui.add_css(STYLE.read_text(encoding="utf-8"))
        ui.colors(primary="#155a8a")
        state, notes = from_query(dict(request.query_params), lab.offer)
        opened = Page(client, gallery, lab, worker, state)
        opened.say(" ".join(notes))
        client.on_delete(opened.close)

    @app.get(f"{ROUTE}/{{page}}/{{key}}")
    def picture(page: str, key: str) -> Response:
        return gallery.get(page, key)

    app.on_shutdown(worker.close)
    print(f"the failure lab is at http://{host}:{port}   (Ctrl-C ends it)", flush=True)
    with suppress(KeyboardInterrupt):
        ui.run(
            host=host, port=port, show=show and has_screen(), reload=False, title="Failure lab", dark=False,
            language="en-US", show_welcome_message=False, favicon=FAVICON, tailwind=False,
        )  # fmt: skip


FAVICON = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 16 16"><rect width="16" height="16" rx="3" fill="#155a8a"/>'
    "</svg>"
)
