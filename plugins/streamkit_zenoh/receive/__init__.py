"""How things are received: a bounded box, numbers that show what was missed, state for late comers.

All but `decoding` import nothing of streamkit.
"""
