"""Potential-field control of a two-link arm among moving discs: the whole arm keeps clear of where they will be.

Every other control period the field looks ahead (:mod:`planners.apf.dodge.field`). The arm is attracted straight to a
posture at its goal (:mod:`planners.apf.dodge.whole_arm`) as long as that motion keeps clear of the predicted discs
(:mod:`planners.apf.dodge.discs`). Where it does not, the field proposes other wells
(:mod:`planners.apf.dodge.proposals`), simulates each of them (:mod:`planners.apf.dodge.look_ahead`), and takes the one
of least cost.
"""

from planners.apf.dodge.field import dodge_accelerations, new_memory
from planners.apf.dodge.gains import STEP, DodgeGains, look_ahead_steps, tuned_gains

__all__ = ["STEP", "DodgeGains", "dodge_accelerations", "look_ahead_steps", "new_memory", "tuned_gains"]
