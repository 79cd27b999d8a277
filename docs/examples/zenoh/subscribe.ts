// Follows a streamkit publisher from a browser or from Deno: docs/zenoh.md describes what travels.
// Needs @eclipse-zenoh/zenoh-ts and a router with the remote-api plugin: zenohd --cfg 'plugins/remote_api/websocket_port:"10000"'

import { Config, Reply, Sample, SampleKind, Session } from "@eclipse-zenoh/zenoh-ts";

interface Track {
  id: number;
  state: "tentative" | "confirmed" | "coasting" | "lost";
  x: number;
  y: number;
  length: number;
  width: number;
  angle: number;
  bbox: [number, number, number, number];
  vx?: number;
  vy?: number;
  position_covariance?: [[number, number], [number, number]];
  score: number;
  age_ns: number;
  geo?: { lat: number; lon: number; error_m?: number };
}

interface TrackRecord {
  schema: "streamkit.tracks/1";
  source: string;
  seq: number;
  epoch: number;
  pts_ns?: number;
  capture_ns?: number; // larger than 2^53: read it with a parser that gives BigInt where every digit counts
  published_ns?: number;
  age_ms?: number;
  width?: number;
  height?: number;
  tracks: Track[];
  dropped: number;
}

// Each message carries "RUN NUMBER" as its attachment: a gap in the numbers of a run is a loss.
const last = new Map<string, bigint>();

function missedBefore(sample: Sample): bigint | undefined {
  const stamp = sample.attachment()?.toString().split("\n")[0].split(" ");
  if (!stamp || stamp.length !== 2) return 0n;
  const stream = `${sample.keyexpr().toString()} ${stamp[0]}`;
  const number = BigInt(stamp[1]);
  const before = last.get(stream);
  if (before !== undefined && number <= before) return undefined;
  last.set(stream, number);
  return before === undefined ? 0n : number - before - 1n;
}

function show(sample: Sample): void {
  const missed = missedBefore(sample);
  if (missed === undefined) return;
  if (missed > 0n) console.log(`missed ${missed}`);
  const record = JSON.parse(sample.payload().toString()) as TrackRecord;
  console.log(record.seq, record.tracks.map((track) => `#${track.id} ${track.x.toFixed(1)} ${track.y.toFixed(1)}`));
}

export async function follow(key: string, locator = "ws/127.0.0.1:10000"): Promise<void> {
  const session = await Session.open(new Config(locator));
  await session.declareSubscriber(`${key}/tracks`, { handler: show });
  await session.liveliness().declareSubscriber(`${key}/alive`, {
    history: true,
    handler: (sample: Sample) => console.log(sample.kind() === SampleKind.PUT ? "publisher there" : "publisher gone"),
  });
  // Who comes late asks for the last record.
  await session.get(`${key}/tracks`, {
    handler: (reply: Reply) => {
      const result = reply.result();
      if (result instanceof Sample) show(result);
    },
  });
}
