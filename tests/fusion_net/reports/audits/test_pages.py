"""What the audits leave on disk: a file that explains itself, a picture, a page."""

import json

import numpy as np
import pytest

from fusion_net.common.boxes import Boxes
from fusion_net.evaluation.audits.association import audit_association, by_distance
from fusion_net.evaluation.audits.calibration import audit_calibration
from fusion_net.evaluation.audits.heat import Heat
from fusion_net.evaluation.audits.result import Audit
from fusion_net.models.late.sensor_calibration import SensorCalibration
from fusion_net.reports.audits.pages import read_audits, write_audit, write_page
from fusion_net.reports.audits.run import AUDITS, chosen_audits


def people(xy):
    n = len(xy)
    center = np.column_stack([xy, np.zeros(n)])
    return Boxes.labels(center, np.ones((n, 3)), np.zeros(n), np.zeros((n, 2)), np.zeros(n, np.int64))


def test_an_audits_file_explains_itself(tmp_path):
    labels = people([(10.0, 0.0), (20.0, 5.0)])
    seen = [SensorCalibration("lidar", num_classes=1).estimates(labels, labels)] * 20
    audit = audit_association({"camera": seen, "lidar": seen}, by_distance(2.0), np.ones((2, 20), np.int64))
    write_audit(tmp_path, audit)
    write_audit(tmp_path, Audit("depth", "Depth", "nothing to see", None, {}, "why"))
    write_page(tmp_path)
    doc = json.loads((tmp_path / "audits/association.json").read_text())
    assert list(doc) == ["name", "title", "verdict", "ok", "numbers", "picture", "explanation"]
    assert doc["ok"] is True
    assert (tmp_path / "audits" / doc["picture"]).stat().st_size > 1000
    assert [each["name"] for each in read_audits(tmp_path)] == ["association", "depth"]
    page = (tmp_path / "audits.md").read_text()
    assert "![association](audits/association.png)" in page
    assert "not judged: nothing to see" in page


def test_a_calibration_audit_without_errors_is_drawn(tmp_path):
    rng = np.random.default_rng(0)
    view = [Heat(rng.uniform(5, 40, (40, 2)), np.tile(np.eye(2), (40, 1, 1)), np.zeros(40, np.int64), np.ones(40))]
    write_audit(tmp_path, audit_calibration({("lidar", "radar"): (view, view)}, None))
    write_page(tmp_path)
    (doc,) = read_audits(tmp_path)
    assert doc["numbers"]["pairs"]["L+R"]["shift_error"] is None
    assert (tmp_path / "audits" / doc["picture"]).stat().st_size > 1000
    assert "not judged: L+R turned" in (tmp_path / "audits.md").read_text()


def test_a_damaged_file_is_named(tmp_path):
    (tmp_path / "audits").mkdir()
    (tmp_path / "audits/depth.json").write_text("{}")
    with pytest.raises(ValueError, match=r"depth.json is no audit .*; delete it"):
        read_audits(tmp_path)


def test_audits_are_chosen_by_name():
    assert chosen_audits("none") == ()
    assert chosen_audits("all") == AUDITS
    assert chosen_audits("depth") == ("depth",)
    assert chosen_audits(["conditions", "depth"]) == ("depth", "conditions")
    with pytest.raises(ValueError, match="unknown audits 'dept'; did you mean 'depth'"):
        chosen_audits("dept")
