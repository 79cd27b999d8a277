// What the elements of the pipeline do: the share of the time that each works, between two states of the publisher.

export class ElementLoad {
  constructor() {
    this.clear();
  }

  clear() {
    this.before = null;
    this.shares = [];
  }

  // Names and shares, 0 to 1, the busiest first. A call counts when it ends, also one that began before.
  note(status) {
    const { before } = this;
    if (!status || before?.published_ns === status.published_ns) return;
    this.before = status;
    const passed = before?.run === status.run ? status.published_ns - before.published_ns : 0;
    if (passed <= 0) return;
    const busy = new Map((before.elements ?? []).map((element) => [element.name, element.busy_ns]));
    this.shares = (status.elements ?? [])
      .filter(({ name }) => busy.has(name))
      .map(({ name, busy_ns }) => ({ name, share: Math.min(1, Math.max(0, busy_ns - busy.get(name)) / passed) }))
      .sort((a, b) => b.share - a.share);
  }
}

// Drops of all places: streams of the publisher, and elements of its pipeline.
export function dropsOf(status) {
  const own = (status?.drops ?? []).map(({ stream, reason, count }) => ({ place: stream, reason, count }));
  const others = (status?.elements ?? []).flatMap(({ name, drops }) => drops.map((drop) => ({ place: name, ...drop })));
  return [...own, ...others].filter(({ count }) => count).sort((a, b) => b.count - a.count);
}
