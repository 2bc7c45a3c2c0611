//! The GPU's prefix sum, sorts and work list against plain host code, for many sizes.

mod common;

use std::mem::offset_of;

use common::{gpu, truth_scene};
use photogram::bits::hash;
use photogram::device_scene::{Context, DeviceScene};
use photogram::field::dirty::Dirty;
use photogram::gpu::Progress;
use photogram::gpu::counter::{COUNTER_STRIPES, CounterBuffer, Counters};
use photogram::gpu::resource::Bytes;
use photogram::gpu::scan::Scanner;
use photogram::gpu::sort::{Sort, Sorter};
use photogram::gpu::work::WorkList;
use photogram::scene::Spatial;
use photogram::segment::{Request, Sources};
use photogram::split::Split;
use photogram::update::PhotonFrame;

/// About the edges of work groups and blocks, and over the square of a block.
const SIZES: [usize; 14] =
    [0, 1, 2, 3, 63, 64, 65, 1023, 1024, 1025, 2048, 4097, 100_000, 1_100_000];
/// Words beyond the end that nobody may touch.
const MARGIN: usize = 70;
const UNTOUCHED: u32 = 0xdead_beef;

fn random(seed: u64, count: usize) -> Vec<u32> {
    (0..count as u64).map(|i| hash(seed << 32 ^ i)).collect()
}

/// The words on the device, with a margin.
fn uploaded(words: &[u32]) -> wgpu::Buffer {
    let padded = [words, &[UNTOUCHED; MARGIN]].concat();
    gpu().upload("words", &padded).expect("it fits")
}

/// The words back, their margin found untouched.
fn fetched(buffer: &wgpu::Buffer) -> Vec<u32> {
    let mut words: Vec<u32> = gpu().read("words", buffer).expect("it reads");
    let margin = words.split_off(words.len() - MARGIN);
    assert!(margin.iter().all(|&w| w == UNTOUCHED), "words beyond the end were written");
    words
}

fn scanned(words: &[u32], capacity: usize) -> Vec<u32> {
    let buffer = uploaded(words);
    let scanner = Scanner::new(gpu(), capacity as u32).expect("it fits");
    let mut stage = gpu().stage("scan");
    scanner.record(&mut stage, &buffer, words.len() as u32).expect("it records");
    stage.finish().expect("it runs");
    fetched(&buffer)
}

fn prefix_sums(words: &[u32]) -> Vec<u32> {
    let before = |sum: &mut u32, &word: &u32| {
        let here = *sum;
        *sum = sum.wrapping_add(word);
        Some(here)
    };
    words.iter().scan(0, before).collect()
}

#[test]
fn the_scan_is_the_exclusive_prefix_sum_modulo_two_to_the_32() {
    for (seed, size) in SIZES.into_iter().enumerate() {
        let words = random(seed as u64, size);
        assert!(scanned(&words, size) == prefix_sums(&words), "{size} words");
    }
}

#[test]
fn the_scan_takes_ones_zeros_and_room_to_spare() {
    for size in [1, 64, 1025, 100_000] {
        for words in [vec![1; size], vec![0; size]] {
            assert!(scanned(&words, 2_000_000) == prefix_sums(&words), "{size} of {}", words[0]);
        }
    }
}

#[test]
fn one_wrong_word_is_seen_in_a_scan() {
    let mut words = random(7, 4097);
    let sums = scanned(&words, words.len());
    words[4000] ^= 1;
    assert!(sums != prefix_sums(&words));
}

/// What a list of `size` items makes of words of marks.
fn listed(words: &[u32], size: usize) -> Vec<u32> {
    let mut list = WorkList::new(gpu(), size as u32).expect("it fits");
    gpu().write(&list.marks, words).expect("writes");
    list.record(gpu().stage("list")).expect("it runs");
    WorkList::learn(gpu(), &mut [&mut list]).expect("it reads");
    let mut items: Vec<u32> = gpu().read("words", &list.items).expect("it reads");
    assert_eq!(items.remove(0), list.count);
    items.truncate(list.count as usize);
    items
}

#[test]
fn a_work_list_has_the_marked_items_in_their_order() {
    for (seed, size) in SIZES.into_iter().enumerate() {
        // Sparse, half of them, all of them; and marks beyond the last item.
        let half = random(seed as u64, size.div_ceil(32));
        let sparse: Vec<_> = half.iter().map(|w| w & w << 9 & w << 17 & w << 25).collect();
        for words in [vec![0; half.len()], sparse, half.clone(), vec![u32::MAX; half.len()]] {
            let marked = |item: &u32| words[*item as usize / 32] >> (item % 32) & 1 == 1;
            let expected: Vec<_> = (0..size as u32).filter(marked).collect();
            assert!(listed(&words, size) == expected, "{size} items");
        }
    }
}

#[test]
fn a_rank_is_how_many_are_marked_in_the_words_before() {
    for (seed, size) in SIZES.into_iter().enumerate() {
        let words = random(seed as u64, size.div_ceil(32));
        let list = WorkList::new(gpu(), size as u32).expect("it fits");
        let ranks = list.ranks(gpu()).expect("it fits");
        gpu().write(&list.marks, &words).expect("writes");
        let mut stage = gpu().stage("ranks");
        list.rank(&mut stage, &ranks).expect("it records");
        stage.finish().expect("it runs");
        let ones: Vec<_> = words.iter().map(|word| word.count_ones()).collect();
        let found: Vec<u32> = gpu().read("words", &ranks).expect("it reads");
        assert!(found[..ones.len()] == prefix_sums(&ones), "{size} items");
    }
}

/// Work is submitted late, and what the host writes must not overtake it.
#[test]
fn writes_wait_for_what_was_recorded_before() {
    let (from, to) = (uploaded(&[1; 64]), uploaded(&[0; 64]));
    let mut stage = gpu().stage("copy");
    stage.copy(Bytes::all(&from), &to, 0);
    stage.finish().expect("it records");
    gpu().write(&from, &[2_u32; 64]).expect("writes");
    assert_eq!(fetched(&to), [1; 64]);
    assert_eq!(fetched(&from), [2; 64]);
}

/// Counters are sums of many parts, each of two words: counted from where every low word is
/// about to overflow, they count as much.
#[test]
fn counts_carry_into_the_upper_words() {
    let (mut scene, volume) = truth_scene("ball_single");
    (scene.camera.width, scene.camera.height, scene.settings.photons) = (16, 16, 100);
    let device = DeviceScene::new(gpu(), &scene, &volume).expect("uploads");
    let mut frame = PhotonFrame::new(gpu(), &scene, device, &Split::default()).expect("fits");
    frame.rebuild(gpu(), &Split::default(), &mut Progress::silent()).expect("rebuilds");
    let PhotonFrame { scene: device, field, segments, .. } = &mut frame;
    let dirty = Dirty::new(gpu(), device, 0.0, Spatial::Exact).expect("fits");
    let mut counted = |counters: &CounterBuffer| {
        let before = counters.read(gpu()).expect("reads").samples;
        let cx = Context { gpu: gpu(), scene: device, counters };
        let from = Sources { field: &**field, dirty: &dirty };
        segments.restart();
        let silent = &mut Progress::silent();
        let request = Request { from, query: u64::MAX, split: &Split::default() };
        segments.begin(cx).expect("begins");
        for at in segments.rays() {
            segments.compute(cx, at, request, silent).expect("computes");
        }
        counters.read(gpu()).expect("reads").samples - before
    };
    let counters = CounterBuffer::new(gpu()).expect("fits");
    let samples = counted(&counters);
    assert!(samples > 1000, "{samples}");
    // Parts lie counter by counter, all low words of one before its upper words.
    let words = counters.buffer().size() as usize / 4;
    let parts = COUNTER_STRIPES as usize;
    let low = 2 * parts * (offset_of!(Counters, samples) / size_of::<u64>());
    let mut full = vec![0; words];
    full[low..low + parts].fill(u32::MAX);
    gpu().write(counters.buffer(), &full).expect("writes");
    assert_eq!(counted(&counters), samples);
}

/// Keys and which they were, as the device sorts them.
fn sorted(keys: &[u32], below: u32, sort: Sort) -> Vec<(u32, u32)> {
    let sorter = Sorter::new(gpu(), keys.len() as u32, below, sort).expect("it fits");
    let buffer = uploaded(keys);
    // Twice: nothing of a sort may be left for the next.
    for _ in 0..2 {
        let mut stage = gpu().stage("sort");
        sorter.record(&mut stage, &buffer, keys.len() as u32).expect("it records");
        stage.finish().expect("it runs");
    }
    assert!(fetched(&buffer) == keys, "keys were written");
    let pairs = sorter.sorted();
    let [keys, order] = [&pairs.keys, &pairs.order]
        .map(|buffer| gpu().read::<u32>("sorted", buffer).expect("it reads"));
    keys.into_iter().zip(order).take(buffer.size() as usize / 4 - MARGIN).collect()
}

#[test]
fn few_large_keys_are_not_counted() {
    assert_eq!(Sort::fastest(1_000_000, 2_000_000), Sort::Counting);
    assert_eq!(Sort::fastest(1_000_000, u32::MAX), Sort::Radix);
}

#[test]
fn sorts_are_as_radsort_has_them() {
    let sizes = [0, 1, 2, 255, 256, 257, 65_535, 65_536, 65_537, 1_000_000];
    for (seed, size) in sizes.into_iter().enumerate() {
        let all = random(seed as u64, size);
        let below = 2 * size.max(1) as u32;
        let few = all.iter().map(|key| key % below).collect::<Vec<_>>();
        let cases = [
            (few.clone(), below, Sort::Counting),
            (few, below, Sort::Radix),
            (all, u32::MAX, Sort::Radix),
            (vec![7; size], 8, Sort::Counting),
            (vec![7; size], 8, Sort::Radix),
            (vec![0; size], 1, Sort::Radix),
        ];
        for (keys, below, sort) in cases {
            let mut expected: Vec<_> = keys.iter().copied().zip(0..).collect();
            radsort::sort_by_key(&mut expected, |(key, _)| *key);
            let mut found = sorted(&keys, below, sort);
            // Equal keys of a counting sort come in any order.
            if sort == Sort::Counting {
                assert!(found.is_sorted_by_key(|(key, _)| *key), "{size} keys below {below}");
                found.sort_unstable();
            }
            assert!(found == expected, "{size} keys below {below}, {sort:?}");
        }
    }
}
