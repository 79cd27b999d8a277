"""Association: which detection belongs to which target.

Contract: `associate(table, observation, ...)` fills the detection fields of the table (`detection`, `gate`,
`detection_std`, `crowded`, `shared`) and returns the detections that are left. `gated_pairs` is the method in
use.
"""
