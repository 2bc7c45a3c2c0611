//! What slots keep of directions and powers, and how powers are weighed.

mod common;

use common::draws::{DRAWS, askew, draws, put, vector};
use glam::{DVec3, dvec3};
use photogram::bits::hash;
use photogram::photon::probe::{ProbeParams, What};
use photogram::scene::LightKind;

/// The hash of `kernels/shared/random.wgsl`, from its paper.
fn pcg4d(key: [u32; 4]) -> [u32; 4] {
    let mut v = key.map(|k| k.wrapping_mul(1_664_525).wrapping_add(1_013_904_223));
    let mix = |v: &mut [u32; 4]| {
        for (to, a, b) in [(0, 1, 3), (1, 2, 0), (2, 0, 1), (3, 1, 2)] {
            v[to] = v[to].wrapping_add(v[a].wrapping_mul(v[b]));
        }
    };
    mix(&mut v);
    v = v.map(|x| x ^ x >> 16);
    mix(&mut v);
    v
}

#[test]
fn packing_keeps_directions_to_a_ten_thousandth_and_powers_to_14_bits() {
    const FOR_SCATTER: u32 = 0x30;
    let volume = askew();
    let scene = put(LightKind::Surroundings, &volume, DVec3::ONE, 800);
    let params = ProbeParams { count: DRAWS, ..Default::default() };
    let [directions, unpacked, powers] = draws(&scene, &volume, What::Packing, params);
    let (mut widest, mut worst): (f64, f64) = (0.0, 0.0);
    for (i, ((&d, &back), &power)) in directions.iter().zip(&unpacked).zip(&powers).enumerate() {
        let (d, back) = (vector(d), vector(back));
        widest = widest.max(d.cross(back).length().atan2(d.dot(back)));
        let words = pcg4d([hash(scene.settings.seed), i as u32, 0, FOR_SCATTER]);
        let u = words.map(|w| f64::from(w >> 8) / f64::from(1 << 24));
        assert_eq!(u[3], f64::from(power[3]), "the draws are not those of the paper's hash");
        let before = dvec3(u[0], u[1], u[2]) * (40.0 * (u[3] - 0.5)).exp2();
        let off = (vector(power) - before).abs().max_element() / before.max_element();
        worst = worst.max(off);
    }
    println!("directions within {widest:.2e} rad, powers within {worst:.2e} of the largest");
    assert!(widest < 1e-4);
    // exp2 on the device is itself good to some 4e-6.
    assert!(worst < 2f64.powi(-14) + 4e-6);
}

/// Integers all the way: what comes out is the exact product, rounded to 14 bits of the
/// largest channel.
#[test]
fn weighing_is_exact_to_14_bits() {
    let volume = askew();
    let scene = put(LightKind::Surroundings, &volume, DVec3::ONE, 802);
    let params = ProbeParams { count: DRAWS, ..Default::default() };
    let [powers, shares, weighed] = draws(&scene, &volume, What::Weighing, params);
    let (mut worst, mut black): (f64, u32) = (0.0, 0);
    for (i, ((&power, &share), &weighed)) in powers.iter().zip(&shares).zip(&weighed).enumerate() {
        let doublings = f64::from(i as u32 % 7);
        let exact = vector(power) * vector(share) * (doublings - 18.0).exp2();
        let largest = exact.max_element();
        if largest == 0.0 {
            assert_eq!(vector(weighed), DVec3::ZERO);
            black += 1;
            continue;
        }
        worst = worst.max((vector(weighed) - exact).abs().max_element() / largest);
    }
    println!("within {worst:.3e} of the largest; {black} black");
    assert!(black > 10);
    // Half a unit of the last of 14 bits, or a whole one where that would be the fifteenth.
    assert!(worst <= 2f64.powi(-14));
}
