"""The real character in her light garments, run once and looked at twice: depths in the body, and crossings."""

from crossings import Body
from test_body_depth import assert_cloth_stays_outside
from test_self_contact import assert_cloth_does_not_cross_the_body, assert_no_crossing


def whole_shot(run_scene):
    return run_scene("tests/scenes/dressed_woman.toml", "0-96")


def test_the_real_characters_garments_stay_outside_it(run_scene, shared_data, report_figure):
    body = shared_data / "woman_walk_dance" / "body.abc"
    assert_cloth_stays_outside(whole_shot(run_scene), body, report_figure)


def test_the_real_characters_garments_cross_neither_each_other_nor_her(run_scene, shared_data, report_figure):
    cloth = assert_no_crossing(whole_shot(run_scene), report_figure)
    body = Body(shared_data / "woman_walk_dance" / "body.abc")
    assert_cloth_does_not_cross_the_body(cloth, body, report_figure)
