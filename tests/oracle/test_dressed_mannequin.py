"""The demo of the mannequin, run once and looked at twice: depths in the body, and crossings."""

import pytest

from crossings import Body
from test_body_depth import assert_cloth_stays_outside
from test_self_contact import SAMPLES, assert_cloth_does_not_cross_the_body, assert_no_crossing


@pytest.fixture(params=["1001-1025", pytest.param("1001-1097", marks=pytest.mark.full)])
def demo(request, run_scene, mannequin):
    return run_scene(f"{SAMPLES}/dressed_mannequin.toml", request.param, assets=mannequin)


def test_the_mannequins_garments_stay_outside_it(demo, mannequin, report_figure):
    assert_cloth_stays_outside(demo, mannequin / "body.abc", report_figure)


def test_the_mannequins_garments_cross_neither_each_other_nor_it(demo, mannequin, report_figure):
    cloth = assert_no_crossing(demo, report_figure)
    assert_cloth_does_not_cross_the_body(cloth, Body(mannequin / "body.abc"), report_figure)
