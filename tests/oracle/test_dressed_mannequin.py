"""The whole demo of the mannequin, run once and looked at twice: depths in the body, and crossings."""

from crossings import Body
from test_body_depth import assert_cloth_stays_outside
from test_self_contact import SAMPLES, assert_cloth_does_not_cross_the_body, assert_no_crossing


def whole_demo(run_scene, mannequin):
    return run_scene(f"{SAMPLES}/dressed_mannequin.toml", "1001-1097", assets=mannequin)


def test_the_mannequins_garments_stay_outside_it_in_the_whole_demo(run_scene, mannequin, report_figure):
    assert_cloth_stays_outside(whole_demo(run_scene, mannequin), mannequin / "body.abc", report_figure)


def test_the_mannequins_garments_cross_neither_each_other_nor_it(run_scene, mannequin, report_figure):
    cloth = assert_no_crossing(whole_demo(run_scene, mannequin), report_figure)
    assert_cloth_does_not_cross_the_body(cloth, Body(mannequin / "body.abc"), report_figure)
