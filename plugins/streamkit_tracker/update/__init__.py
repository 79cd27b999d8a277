"""Update: measures every target in the frame and corrects its state, window and template.

Contract: `update(table, ...)` searches the targets whose appearance is known with the layered particle
filter (`search`), judges the result (`evidence`), corrects means and covariances, and keeps windows in
agreement with the detections (`detected_box`). A correlation filter leads targets drawn by hand
(`response`).
"""
