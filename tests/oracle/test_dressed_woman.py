"""The real character in her light garments, run once and looked at twice: depths in the body, and crossings."""

import pytest

from crossings import Body
from test_body_depth import assert_cloth_stays_outside
from test_self_contact import assert_cloth_does_not_cross_the_body, assert_no_crossing


@pytest.fixture(params=["0-24", pytest.param("0-96", marks=pytest.mark.full)])
def shot(request, run_scene):
    return run_scene("tests/scenes/dressed_woman.toml", request.param)


def test_the_real_characters_garments_stay_outside_it(shot, shared_data, report_figure):
    body = shared_data / "woman_walk_dance" / "body.abc"
    assert_cloth_stays_outside(shot, body, report_figure)


def test_the_real_characters_garments_cross_neither_each_other_nor_her(shot, shared_data, report_figure):
    cloth = assert_no_crossing(shot, report_figure)
    body = Body(shared_data / "woman_walk_dance" / "body.abc")
    assert_cloth_does_not_cross_the_body(cloth, body, report_figure)
