//! Follows a streamkit publisher: docs/zenoh.md describes what travels.
//!
//!     cargo run -- uav/1 tcp/192.168.0.7:7447

use std::collections::HashMap;

use serde::Deserialize;
use zenoh::sample::{Sample, SampleKind};

#[derive(Debug, Deserialize)]
struct Track {
    id: i64,
    state: String,
    x: f64,
    y: f64,
    vx: Option<f64>,
    vy: Option<f64>,
}

/// What this program needs of a record; fields that are not named here are skipped.
#[derive(Debug, Deserialize)]
struct TrackRecord {
    schema: String,
    seq: u64,
    epoch: u64,
    capture_ns: Option<i64>,
    published_ns: Option<i64>,
    tracks: Vec<Track>,
}

/// Counts what was missed: each message carries `RUN NUMBER` as its attachment.
#[derive(Default)]
struct Gaps(HashMap<(String, String), u64>);

impl Gaps {
    /// How many messages of this key are missing before this one; None where it was here before.
    fn missed_before(&mut self, sample: &Sample) -> Option<u64> {
        let Some(attachment) = sample.attachment() else { return Some(0) };
        let text = attachment.try_to_string().ok()?.into_owned();
        let Some((run, number)) = text.lines().next().and_then(|line| line.split_once(' ')) else {
            return Some(0);
        };
        let Ok(number) = number.parse::<u64>() else { return Some(0) };
        let stream = (sample.key_expr().to_string(), run.to_string());
        match self.0.insert(stream.clone(), number) {
            None => Some(0),
            Some(last) if number > last => Some(number - last - 1),
            Some(last) => {
                self.0.insert(stream, last);
                None
            }
        }
    }
}

fn show(gaps: &mut Gaps, sample: &Sample) {
    let Some(missed) = gaps.missed_before(sample) else { return };
    if missed > 0 {
        println!("missed {missed}");
    }
    match serde_json::from_slice::<TrackRecord>(&sample.payload().to_bytes()) {
        Ok(record) if record.schema == "streamkit.tracks/1" => println!("{record:?}"),
        Ok(record) => eprintln!("another schema: {}", record.schema),
        Err(error) => eprintln!("not a record: {error}"),
    }
}

#[tokio::main]
async fn main() -> zenoh::Result<()> {
    let arguments: Vec<String> = std::env::args().collect();
    let key = arguments.get(1).map_or("uav/1", String::as_str);
    let mut config = zenoh::Config::default();
    if let Some(endpoint) = arguments.get(2) {
        config.insert_json5("mode", "\"client\"")?;
        config.insert_json5("connect/endpoints", &format!("[\"{endpoint}\"]"))?;
    }
    let session = zenoh::open(config).await?;
    let records = session.declare_subscriber(format!("{key}/tracks")).await?;
    let alive = session.liveliness().declare_subscriber(format!("{key}/alive")).history(true).await?;
    let mut gaps = Gaps::default();
    // Who comes late asks for the last record.
    let replies = session.get(format!("{key}/tracks")).await?;
    while let Ok(reply) = replies.recv_async().await {
        if let Ok(sample) = reply.result() {
            show(&mut gaps, sample);
        }
    }
    loop {
        tokio::select! {
            sample = records.recv_async() => show(&mut gaps, &sample?),
            token = alive.recv_async() => {
                let there = token?.kind() == SampleKind::Put;
                println!("publisher {}", if there { "there" } else { "gone" });
            }
        }
    }
}
