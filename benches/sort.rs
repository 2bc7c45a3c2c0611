//! Keys a second of the two sorts, by how many there are and how large they may be.
//!
//!     cargo bench --bench sort -- [--out FOLDER]
//!
//! Figures are medians of five runs on random keys; writes `sort.csv` to the folder (out/sort).

use std::fmt::Write;
use std::path::PathBuf;
use std::time::Instant;

use clap::Parser;
use photogram::bits::hash;
use photogram::gpu::AdapterChoice;
use photogram::gpu::sort::{Sort, Sorter};

#[derive(Parser)]
struct Args {
    #[arg(long, default_value = "out/sort")]
    out: PathBuf,
    /// Given by cargo
    #[arg(long, hide = true)]
    bench: bool,
}

const RUNS: usize = 5;

fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    let gpu = pollster::block_on(photogram::open(&AdapterChoice::Best))?;
    println!("adapter: {}", gpu.report().name);
    let mut csv = String::from("keys,below,sort,million_keys_a_second\n");
    for count in [100_000_u32, 1_000_000, 10_000_000] {
        let half: u32 = count / 2;
        for below in [half, 2 * count, 4 * count, 32 * count.min(1 << 23), u32::MAX] {
            let keys = (0..u64::from(count)).map(|i| hash(i) % below).collect::<Vec<_>>();
            let keys = gpu.upload("keys", &keys)?;
            for sort in [Sort::Counting, Sort::Radix] {
                // What is counted has to fit a binding.
                if sort == Sort::Counting && u64::from(below) * 4 + 4 > gpu.max_binding() {
                    continue;
                }
                let sorter = Sorter::new(&gpu, count, below, sort)?;
                let mut times = Vec::new();
                for _ in 0..=RUNS {
                    gpu.take_timings()?;
                    let begun = Instant::now();
                    let mut stage = gpu.stage("sort");
                    sorter.record(&mut stage, &keys, count)?;
                    stage.finish()?;
                    gpu.take_timings()?;
                    times.push(begun.elapsed().as_secs_f64());
                }
                // The first is for kernels and memory to be had.
                times.remove(0);
                times.sort_by(f64::total_cmp);
                let rate = f64::from(count) / times[RUNS / 2] * 1e-6;
                println!("{count:>9} keys below {below:>10}: {sort:?} {rate:.2} million a second");
                writeln!(csv, "{count},{below},{sort:?},{rate:.3}")?;
            }
        }
    }
    std::fs::create_dir_all(&args.out)?;
    std::fs::write(args.out.join("sort.csv"), csv)?;
    Ok(())
}
