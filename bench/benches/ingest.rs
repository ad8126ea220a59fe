//! Bytes of a scan file to points.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use mluc_bench::inputs;
use mluc_ingest::decode_bin;
use mluc_ipc_types::Point;

fn decode_scan(c: &mut Criterion) {
    let scan = inputs::simulated(0).expect("a simulated scan").points;
    let bytes: &[u8] = bytemuck::cast_slice(&scan);
    let mut points = vec![Point::default(); scan.len()];
    let mut group = c.benchmark_group("decode scan");
    group.throughput(Throughput::Elements(scan.len() as u64));
    group.bench_function(format!("{} points", scan.len()), |b| {
        b.iter(|| decode_bin(bytes, &mut points))
    });
    group.finish();
}

criterion_group!(benches, decode_scan);
criterion_main!(benches);
