"""Traffic rendered over an aerial photograph, with exact truth, for the differencer's benchmark."""

from dataclasses import dataclass, field

import aerial_flights
import cv2
import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
ByteImage = npt.NDArray[np.uint8]

SHAPE = (720, 1280)
FRAMES = 110
NOISE = 3.0
# Pixels this near to an outline are neither right nor wrong, as in the truth of changedetection.net.
OUTLINE_PX = 1
WARM_UP = 30


@dataclass(frozen=True, eq=False)
class Kind:
    """What is rendered.

    Attributes:
        moving: whether the camera flies.
        blocks: tall blocks along the path.
        lengths: shortest and longest mover, px.
        speeds: slowest and fastest, px per frame.
    """

    moving: bool = True
    blocks: int = 0
    lengths: tuple[float, float] = (12.0, 40.0)
    speeds: tuple[float, float] = (1.5, 6.0)


KINDS = {
    "static": Kind(moving=False),
    "moving": Kind(),
    "moving + 25 blocks": Kind(blocks=25),
    "small slow": Kind(lengths=(8.0, 16.0), speeds=(1.0, 3.0)),
}


@dataclass(eq=False)
class Traffic:
    """Frames, where they lie on the ground, and what moves in them."""

    kind: Kind
    seed: int
    movers: int = 8
    to_ground: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        self._rendered: dict[int, tuple[ByteImage, ByteImage, ByteImage]] = {}
        random = np.random.default_rng(self.seed)
        grey = cv2.cvtColor(aerial_flights.ground_picture(), cv2.COLOR_BGR2GRAY)
        self.ground = np.asarray(cv2.resize(grey, None, fx=1.5, fy=1.5, interpolation=cv2.INTER_CUBIC))
        if random.random() < 0.5:
            self.ground = np.ascontiguousarray(self.ground[:, ::-1])
        self.to_ground = np.array([self._camera(random, index) for index in self._times(random)])
        middle = self._middles()
        self._movers(random, middle)
        self.blocks = [self._block(random, middle) for _ in range(self.kind.blocks)]

    def _times(self, random: np.random.Generator) -> FloatArray:
        size = np.array(self.ground.shape[::-1], float)
        heading = random.uniform(0, 2 * np.pi)
        self._velocity = random.uniform(2.5, 4.5) * np.array([np.cos(heading), np.sin(heading)])
        self._start = size * random.uniform(0.4, 0.6, 2)
        self._turn, self._zoom = random.normal(0, 0.002), random.normal(0, 0.0006)
        return np.arange(FRAMES) - FRAMES / 2 if self.kind.moving else np.zeros(FRAMES)

    def _camera(self, random: np.random.Generator, time: float) -> FloatArray:
        shake = random.normal(0, 0.5, 2) if self.kind.moving else np.zeros(2)
        lean = 1e-5 * np.sin(time / 15) * np.array([1.0, -0.5]) if self.kind.moving else np.zeros(2)
        place = self._start + time * self._velocity + shake
        return aerial_flights.camera(place, self._turn * time, float(np.exp(self._zoom * time)), lean, SHAPE)

    def _middles(self) -> FloatArray:
        middle = np.array([[[SHAPE[1] / 2, SHAPE[0] / 2]]])
        return np.array([cv2.perspectiveTransform(middle, matrix)[0, 0] for matrix in self.to_ground])

    def _movers(self, random: np.random.Generator, middle: FloatArray) -> None:
        heading = random.uniform(0, 2 * np.pi, self.movers)
        self._speeds = random.uniform(*self.kind.speeds, self.movers)[:, None] * np.column_stack(
            [np.cos(heading), np.sin(heading)]
        )
        # In view at a time of their own, so that they come and go.
        met = random.integers(20, FRAMES, self.movers)
        place = middle[met] + random.uniform(-0.4, 0.4, (self.movers, 2)) * SHAPE[::-1]
        self._places = place - met[:, None] * self._speeds
        self._lengths = random.uniform(*self.kind.lengths, self.movers)
        self._angles = np.degrees(heading)
        dark = random.random(self.movers) < 0.5
        self._tones = np.where(
            dark, random.uniform(15, 60, self.movers), random.uniform(190, 245, self.movers)
        )

    def _block(self, random: np.random.Generator, middle: FloatArray) -> tuple[FloatArray, float, float]:
        place = middle[random.integers(FRAMES)] + random.uniform(-0.6, 0.6, 2) * SHAPE[::-1]
        width, depth, angle = random.uniform(30, 90), random.uniform(30, 90), random.uniform(0, 90)
        base = cv2.boxPoints(((float(place[0]), float(place[1])), (width, depth), angle))
        return base.astype(float), random.uniform(0.04, 0.15), random.uniform(60, 220)

    def outlines(self, index: int) -> FloatArray:
        """The movers in frame `index`, float64[n, 4, 2], px."""
        boxes = []
        for mover in range(self.movers):
            x, y = self._places[mover] + index * self._speeds[mover]
            length = float(self._lengths[mover])
            boxes.append(
                cv2.boxPoints(((float(x), float(y)), (length, 0.5 * length), float(self._angles[mover])))
            )
        matrix = np.linalg.inv(self.to_ground[index])
        return cv2.perspectiveTransform(np.array(boxes, float).reshape(1, -1, 2), matrix).reshape(-1, 4, 2)

    def frame(self, index: int) -> tuple[ByteImage, ByteImage, ByteImage]:
        """The picture, the movers' mask and what must not be judged, each uint8[h, w]."""
        if index not in self._rendered:
            self._rendered[index] = self._render(index)
        return self._rendered[index]

    def _render(self, index: int) -> tuple[ByteImage, ByteImage, ByteImage]:
        matrix = np.linalg.inv(self.to_ground[index])
        view = cv2.warpPerspective(self.ground, matrix, SHAPE[::-1], borderMode=cv2.BORDER_REFLECT)
        truth, ignored = np.zeros(SHAPE, np.uint8), np.zeros(SHAPE, np.uint8)
        for outline, tone in zip(self.outlines(index), self._tones, strict=True):
            middle = outline.mean(axis=0)
            fill(view, outline, tone)
            fill(view, middle + 0.5 * (outline - middle), 255 - tone)
            fill(truth, outline, 255)
        self._raise_blocks(view, truth, matrix, index)
        edge = cv2.morphologyEx(truth, cv2.MORPH_GRADIENT, np.ones((2 * OUTLINE_PX + 1,) * 2, np.uint8))
        ignored[edge > 0] = 255
        random = np.random.default_rng((self.seed, index))
        noisy = view + NOISE * random.standard_normal(SHAPE, dtype=np.float32)
        return np.clip(np.rint(noisy), 0, 255).astype(np.uint8), truth, ignored

    def _raise_blocks(self, view: ByteImage, truth: ByteImage, matrix: FloatArray, index: int) -> None:
        nadir = cv2.perspectiveTransform(np.array([[[SHAPE[1] / 2, SHAPE[0] / 2]]]), self.to_ground[index])[
            0, 0
        ]
        for base, height_share, tone in self.blocks:
            roof = base + height_share * (base - nadir)
            both = cv2.perspectiveTransform(np.concatenate([base, roof])[None], matrix)[0]
            hull = cv2.convexHull(both.astype(np.float32))[:, 0].astype(float)
            for picture, wall, top in ((view, 0.6 * tone, tone), (truth, 0, 0)):
                fill(picture, hull, wall)
                fill(picture, both[4:], top)


def fill(picture: ByteImage, outline: FloatArray, tone: float) -> None:
    """Paints a polygon with smooth edges."""
    cv2.fillPoly(picture, [np.round(outline * 16).astype(np.int32)], float(tone), cv2.LINE_AA, 4)


@dataclass
class Score:
    """Pixels and objects against truth."""

    pixels: FloatArray = field(default_factory=lambda: np.zeros(3))
    objects: FloatArray = field(default_factory=lambda: np.zeros(3))
    errors: list[float] = field(default_factory=list)

    def add(self, mask: ByteImage, centroids: FloatArray, traffic: Traffic, index: int) -> None:
        """Counts a frame; what is cut by the frame or hidden by a block for a third is left out."""
        _, truth, ignored = traffic.frame(index)
        found, true, judged = mask > 0, truth > 127, ignored == 0
        self.pixels += [
            np.count_nonzero(judged & found & true),
            np.count_nonzero(judged & found & ~true),
            np.count_nonzero(judged & ~found & true),
        ]
        taken: set[int] = set()
        for outline in traffic.outlines(index):
            middle = outline.mean(axis=0)
            reach = max(8.0, 0.5 * float(np.linalg.norm(outline[0] - outline[2])))
            near = [
                (float(np.linalg.norm(centre - middle)), number)
                for number, centre in enumerate(centroids)
                if number not in taken
            ]
            best = min(near, default=(np.inf, -1))
            if best[0] <= reach:
                taken.add(best[1])
            alone = np.zeros(SHAPE, np.uint8)
            fill(alone, outline, 255)
            area = cv2.contourArea(outline.astype(np.float32))
            if np.count_nonzero((alone > 127) & true) < 0.67 * area:
                continue
            self.objects += [best[0] <= reach, 0, best[0] > reach]
            if best[0] <= reach:
                self.errors.append(best[0])
        self.objects[1] += len(centroids) - len(taken)

    @staticmethod
    def f_measure(counts: FloatArray) -> float:
        """From right, false and missed."""
        return float(2 * counts[0] / max(1.0, 2 * counts[0] + counts[1] + counts[2]))
