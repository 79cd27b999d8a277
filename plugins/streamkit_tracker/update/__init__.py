"""Update: measures every target in the frame and corrects its state, window and template.

In the order of `MultiTargetTracker.step`: `follow_detections` moves boxes, `measure` searches the targets
whose appearance is known with the layered particle filter and judges the result (`evidence`),
`predict.correct` corrects means and covariances, `follow_boxes` puts windows on the detections,
`learn_detected` updates templates, and `follow_drawn` filters and detectors. A correlation filter leads
targets drawn by hand (`response`). Functions read whole columns, `rows["x"]`, and write one target by
`rows[i]["x"] = ...`.
"""
