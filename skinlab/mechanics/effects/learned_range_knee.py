"""A deflection sensor whose slope changes at a share of each dome: of a range set for each."""

from __future__ import annotations

from skinlab.mechanics.effects.learned_sensor_knee import LearnedRangeKnee

EFFECT = LearnedRangeKnee()
