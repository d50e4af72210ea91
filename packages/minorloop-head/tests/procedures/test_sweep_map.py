import json
import math
from dataclasses import replace
from io import BytesIO

import numpy as np
import pytest

from minorloop_head.procedures.sweep_map import (
    columns_within,
    draw_finding,
    draw_pipe_map,
    find_rows,
    finds_table,
    mapped_share,
)
from minorloop_head.reconstruction.depth_map import (
    ECHOES,
    DepthMap,
    Patch,
    WaterLine,
    camera_map,
    unseen_map,
)
from minorloop_head.ultrasound.c_scan import CScan, EchoFind

PATCH = Patch.ring(20e-3, 22e-3)
PIT = EchoFind("pit", -0.1, 21.04e-3, 1e-3, 1.1e-3, 0.5e-3, 5e-6)
CRACK = EchoFind("crack", 0.2, 21e-3, 0.3e-3, 2e-3)


def swept(*around, finds=(PIT, CRACK), water=None):
    """A map of which the part between two angles has echoes."""
    columns = columns_within(PATCH, around)
    wall = unseen_map(PATCH)
    depth, sd, source = wall.depth.copy(), wall.sd.copy(), wall.source.copy()
    depth[:, columns], sd[:, columns], source[:, columns] = 0.0, 1e-5, ECHOES
    amplitude = np.where(source == ECHOES, 1.0, np.nan)
    known = DepthMap(PATCH, depth, sd, source)
    line = WaterLine(-0.01 if water is None else water, 1e-4, 0.0, water is not None)
    gap = np.isnan(amplitude)
    return CScan(known, amplitude, gap, line, finds, (1e-6, 0.03))


def test_findings_are_numbers_and_null_where_they_are_not_known():
    (pit, crack), table = find_rows(swept(-0.3, 0.3)), finds_table(swept(-0.3, 0.3))
    assert pit["find"] == "pit"
    assert pit["z [mm]"] == 21.04
    assert all(isinstance(value, float) for name, value in pit.items() if name != "find")
    assert json.loads(json.dumps(crack))["depth [mm]"] is None
    assert table.rows[0][1:3] == ("-5.7", "21.04")
    assert table.rows[1][5:] == ("-", "-")


def test_the_share_that_is_mapped_is_of_the_area_also_across_the_seam():
    fused = swept(-0.3, 0.1)
    assert mapped_share(fused, (-0.3, 0.1)) == 1.0
    assert mapped_share(fused, (-0.3, 0.5)) == pytest.approx(0.5, abs=0.02)
    assert mapped_share(fused, (2 * math.pi - 0.3, 2 * math.pi + 0.1)) == 1.0
    assert columns_within(PATCH, None).size == PATCH.columns
    assert columns_within(PATCH, (0.0, 2 * math.pi)).size == PATCH.columns


@pytest.mark.parametrize(("brief", "count"), [(False, 4), (True, 2)])
def test_the_area_is_drawn_and_the_rest_of_the_pipe_is_not(brief, count):
    fused = swept(-0.3, 0.3, water=0.0)
    figure = draw_pipe_map(fused, (-0.3, 0.3), brief=brief)
    panels = figure.axes[:count]
    assert len(figure.axes) == 2 * count
    for axes in panels:
        low, high = axes.get_images()[0].get_extent()[:2]
        assert (high - low) == pytest.approx(math.degrees(0.6), abs=1.0)
    assert np.isfinite(panels[0].get_images()[0].get_array()).all()
    marks = [line for line in panels[1].lines if line.get_marker() in ("o", "s")]
    assert len(marks) == 2
    assert all(low < line.get_xdata()[0] < high for line in marks)


LONG = Patch(0.3, 20e-3, 60, 24, step=0.1e-3)


def cracked():
    crack = np.zeros((60, 24), bool)
    crack[10:50, 11:13] = True
    return camera_map(LONG, np.ones((60, 24), bool), crack)


def test_a_surface_is_of_whole_quads_and_is_open_where_nothing_is_known():
    wall = cracked()
    heard = replace(wall, source=np.full_like(wall.source, ECHOES))
    figure = draw_finding(heard)
    figure.savefig(BytesIO(), format="png")
    (solid,) = [axes for axes in figure.axes if hasattr(axes, "get_zlim")]
    (faces,) = solid.collections
    paths = faces.get_paths()
    assert {len(path.vertices) for path in paths} == {5}
    # Each of 60 by 24 texels is four by four faces across, fewer by those at the crack.
    assert 0.8 * np.isfinite(wall.depth).sum() < len(paths) / 4 < np.isfinite(wall.depth).sum()
