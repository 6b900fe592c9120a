"""The trust region: monotone laws of the update, and each of its branches."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ampi.scp.condensed.trust_region import TrustRegion, TrustRegionSettings

laws = settings(deadline=None, max_examples=200)
SETTINGS = TrustRegionSettings()
radii = st.floats(1e-6, 4.0)
shares = st.floats(1e-3, 1.0)  # step over radius


def updated(radius: float, ratio: float, step: float, *, just_shrunk: bool = False) -> TrustRegion:
    """A region after one step."""
    region = TrustRegion(SETTINGS, radius, just_shrunk)
    region.update(ratio, step)
    return region


@laws
@given(radius=radii, share=shares, ratio=st.floats(-10.0, 0.2499))
def test_a_bad_step_leaves_a_region_without_it(radius: float, share: float, ratio: float) -> None:
    step = share * radius
    region = updated(radius, ratio, step)
    assert region.radius <= 0.5 * step
    assert region.just_shrunk


@laws
@given(radius=radii, share=shares, ratio=st.floats(0.25, 0.7))
def test_a_fair_step_changes_nothing(radius: float, share: float, ratio: float) -> None:
    assert updated(radius, ratio, share * radius).radius == radius


@laws
@given(radius=radii, share=shares, ratio=st.floats(0.701, 2.0), just_shrunk=st.booleans())
def test_a_good_step_grows_the_region_it_fills(
    radius: float, share: float, ratio: float, just_shrunk: bool
) -> None:
    region = updated(radius, ratio, share * radius, just_shrunk=just_shrunk)
    if share > 0.8001:
        factor = SETTINGS.grow_after_shrink if just_shrunk else SETTINGS.grow
        assert region.radius == pytest.approx(min(factor * radius, SETTINGS.largest))
        assert not region.just_shrunk
    elif share < 0.7999:
        assert region.radius == radius
        assert region.just_shrunk is just_shrunk
    assert region.radius <= SETTINGS.largest


def test_rejection_shrinks_more_than_a_poor_step() -> None:
    assert updated(1.0, 0.1, 1.0).radius == pytest.approx(0.5)
    assert updated(1.0, -0.1, 1.0).radius == pytest.approx(0.35)
    assert updated(1.0, -float("inf"), 0.4).radius == pytest.approx(0.14)


def test_growth_is_careful_once_after_a_rejection() -> None:
    region = TrustRegion(SETTINGS, 1.0)
    region.update(-1.0, 1.0)
    region.update(0.9, region.radius)
    assert region.radius == pytest.approx(0.35 * 1.3)
    region.update(0.9, region.radius)
    assert region.radius == pytest.approx(0.35 * 1.3 * 2.5)


def test_collapse() -> None:
    region = TrustRegion(SETTINGS, 1.0)
    assert not region.collapsed
    count = 0
    while not region.collapsed:
        region.update(-1.0, region.radius)
        count += 1
    assert region.radius < 1e-6
    assert count == 14  # 0.35^14 = 4.1e-7
