import cv2

import streamkit

with streamkit.open("flight.mp4", "stitch ! framediff ! waveleteigen ! particletrack") as video:
    for frame in video:
        image = frame.data.copy()
        for track in frame.tracks:
            if track.state in streamkit.SHOWN_STATES:
                centre = round(track.x), round(track.y)
                cv2.circle(image, centre, 12, (0, 0, 255), 2)
                cv2.putText(image, str(track.id), centre, cv2.FONT_HERSHEY_SIMPLEX, 0.6, (0, 0, 255))
        cv2.imwrite("tracked.png", image)
