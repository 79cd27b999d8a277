"""The words of the result page: what was read how, and what cannot be had."""

BEGINNING = """# The published tables, repeated

Zhang, Liu and Qu, "Research on Feature Extraction Method of UAV Video Image Based on Target Tracking",
test their feature extraction on two databases of stills, ORL (40 faces, 10 pictures each) and COIL-20 (20
objects on a turntable, 24 views 15 degrees apart; the paper prints "150 rotation"). This page holds our
figures beside the printed ones. It is written by the program:

    streamkit experiments --data FOLDER --output docs

FOLDER holds `orl/` and `coil20/`; neither database is shipped (both are for research; ORL is from AT&T
Laboratories Cambridge, COIL-20 from Columbia University). The command needs `pip install
'streamkit[experiments]'`. Seeds are fixed and nothing in the files depends on the time: a second run
writes the same bytes.

Pictures are scaled to 64x64 and cut into 16 blocks of 16x16. For each of {repetitions} seeds 1000, 1001,
... the pictures of every target are divided at random: 5train has 200 training and 200 test pictures,
3train 120 and 280, 12train 240 and 240, 9train 180 and 300. The classifier is the nearest neighbour.
Tracking errors come from {runs} sequences for each partition.
"""

CHOICE = """## How the preset was chosen

No test picture took part. For each split its *training* pictures were divided again, three quarters to
learn from and the rest to ask (2 random inner splits), each candidate was measured there, and the best
was then tested once on the split's test pictures: the last row. The candidates are the preset `modular`,
and the preset `recognition` with other numbers of eigenvectors and kinds of virtual views. The preset
that ships, `recognition`, is the candidate "mirrored, 60", the same for all four partitions.
"""

PERCENTAGE_READINGS = """## Tables 1 and 3: "feature extraction percentage"

The publication does not define it. These are the readings that can be measured:

- **A**: recognition with a gallery of k targets, k = 1 to 10. Eigenspace and gallery come from the
  training pictures of the k targets (the first k of a random order that belongs to the split), the test
  pictures of the same targets are asked. With one target every answer is right.
- **B**: held-out reconstruction, the mean of 100 (1 - |x - x'| / |x|) over the test pictures of k
  targets, x' being the reconstruction from the whole-picture eigenvectors that hold 95 % of the variance
  of their training pictures.
- **C**: recognition over all targets with 1 to 10 features for each block.

"Paper chain" is the preset `paper`: db8, equalised LL, soft threshold, inverse transform, equalisation,
one basis for all 16 blocks, 10 features each, block distances summed. "Traditional" is whole-picture PCA
with 40 components on raw pixels; the publication does not say what its traditional method is.
"""

FIGURE = """## Figure 3

![Recognition by number of targets: proposed and traditional method with error bars](paper-figure-3.svg)

The publication shows two plots without axes that could be read, and says "up to 80 %" for its method and
"only 65 %" for the traditional one. Both are drawn here on the same axes under reading A, with the
standard deviation of the splits as error bars. The lead of 15 points that the publication claims is not
there.
"""

ERRORS_READING = """## Tables 2 and 4: "target tracking error"

No unit and no sequence is given, and the databases hold stills. Our reading: the mean distance in px
between the tracked and the true middle of the target over a sequence, and n is the number of runs
averaged. A run takes a target, learns its eigenspace from the training pictures of that target alone, and
tracks its test pictures, shown one after the other in the split's random order (on COIL-20 the object
jumps from view to view), 48 px wide, on a moving textured ground of 320x240 px with noise of 3 grey
levels, for 24 frames. The elements are `waveleteigen` with the saved space and `particletrack
compare=features` with 120, 4 and 4 particles. Settings were fixed before the run and not fitted to the
tables; agreement would be chance.
"""

LIMITS = """## What cannot be reproduced, and why

- **The numbers themselves.** Neither "feature extraction percentage" nor "target tracking error" is
  defined, no parameter of the chain is given (threshold, number of features, particles), and neither are
  the splits. What can be repeated is the protocol.
- **Table 1's average.** The printed 78.08 is not the mean of its cells, which is 81.87; the abstract and
  the conclusion repeat the wrong number. The other three averages agree with their cells.
- **Level and shape at once.** The shape of tables 1 and 3, flat with more training pictures and falling
  with the number of targets with fewer, is that of reading A; their level on ORL, 75 to 87 %, is nearer
  to reading B. No one reading gives both.
- **Tables 2 and 4.** What was tracked in two databases of stills is not said. Under our reading a few runs
  lose the target and miss it by tens of px, which the deviations show.
- **Figure 3's 80 and 65 %.** They do not follow from any table, and the method called traditional is not
  named.
- **The merit of the preparation.** The published preparation lowers recognition here for the PCA family,
  most for whole pictures: equalisation amplifies what differs between pictures of one target. It ships as
  `mode=paper`, with switches.
- **The claim about drones.** Faces and turntable objects are no video from the air; nothing on this page
  says how well features work there.
"""
