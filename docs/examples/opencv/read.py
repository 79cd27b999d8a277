import streamkit

with streamkit.open("flight.mp4") as video:
    for frame in video:
        print(frame.seq, frame.pts, frame.data.shape)
