import cv2
import numpy as np

import streamkit
from streamkit import RegistrationStatus

mean = np.zeros((720, 1280), np.float32)
with streamkit.open("flight.mp4", "stitch", format="GRAY8") as video:
    for number, frame in enumerate(video, 1):
        found = frame.registration
        if found is not None and found.status is RegistrationStatus.OK:
            on_ground = cv2.warpPerspective(frame.data, found.to_reference, (1280, 720))
            mean += (on_ground - mean) / number
cv2.imwrite("mean.png", mean.astype(np.uint8))
