"""Why a camera cannot measure distance: y = f Y / Z, so an object twice as tall and twice as far fills the same pixels."""

from fusion_lab.engine.answers import Answer
from fusion_lab.views.content import Content, svg, table, text

FOCAL, PERSON, SIGN = 1000.0, 1.5, 3.0
"""The lesson's numbers: focal length in pixels, heights in metres."""
WIDTH, HEIGHT, GROUND = 560, 190, 160


def content(answer: Answer) -> Content:
    """Two objects on one ray, and their heights in pixels."""
    near, far = answer.state.metres, answer.state.metres * SIGN / PERSON
    rows = [
        ("person", f"{PERSON:g} m", f"{near:g} m", f"{FOCAL:g} · {PERSON:g} / {near:g} = {FOCAL * PERSON / near:.1f}"),
        ("sign", f"{SIGN:g} m", f"{far:g} m", f"{FOCAL:g} · {SIGN:g} / {far:g} = {FOCAL * SIGN / far:.1f}"),
    ]
    own = ""
    if len(answer.sample.cam_K):
        focal = answer.sample.cam_K[0][1, 1]
        own = (
            f"<p>This car's camera has f = {focal:.0f} pixels: both are {focal * PERSON / near:.1f} pixels tall. Some scenes"
            " have people of twice the size: the camera takes them for near ones, and LiDAR or radar put them right. With the"
            " depth set to 'uniform' the camera admits that it does not know.</p>"
        )
    head = ("", "height Y", "distance Z", "pixels f·Y/Z")
    return Content(_drawing(near, far) + table(rows, head) + own)


def _drawing(near: float, far: float) -> str:
    """The pinhole on the left, a person and a sign whose tops lie on one ray."""
    scale = (WIDTH - 60) / 100.0
    tall = 30.0
    parts = [f'<line x1="0" y1="{GROUND}" x2="{WIDTH}" y2="{GROUND}" class="axis"/>']
    for distance, height, name in ((near, PERSON, "person"), (far, SIGN, "sign")):
        x, top = 30 + scale * distance, GROUND - tall * height
        parts.append(f'<line x1="{x:.1f}" y1="{GROUND}" x2="{x:.1f}" y2="{top:.1f}" class="object"/>')
        parts.append(text(x + 8, (top + GROUND) / 2 + 10, f"{name}, {height:g} m"))
        parts.append(text(x, GROUND + 18, f"{distance:g} m", 'text-anchor="middle"'))
    x, top = 30 + scale * far, GROUND - tall * SIGN
    parts.append(f'<line x1="30" y1="{GROUND}" x2="{x:.1f}" y2="{top:.1f}" class="ray"/>')
    parts.append(f'<circle cx="30" cy="{GROUND}" r="5" class="merge"/>' + text(2, GROUND + 18, "camera"))
    said = f"A person at {near:g} m and a sign of twice the height at {far:g} m end on the same ray"
    return svg(WIDTH, HEIGHT, "".join(parts), said)
