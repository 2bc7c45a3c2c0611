// Free flight by marks, H(6) without its march-step bias.
//
// Tentative collisions form a Poisson process of the scene's fixed majorant; each
// carries a mark in [0, 1) and is real where mark * majorant < extinction. The
// process restarts at every macro-cell, keyed by the cell, so a skipped cell needs
// no draws and no random point depends on the materials.

import package::shared::random::{pcg4d, unit, exponential};
import package::shared::scene::{frame, optics, cell_masks, entry_at, bin_bit, cell_index};
import package::shared::walk::{line, inside, walk_begin, walk_leave, walk_step};

struct Flight {
    distance: f32,         // mm to the collision, or to the exit
    entry: u32,            // the table entry that decided the collision
    collided: bool,
    history: vec2<u32>,    // bins of everything that was looked at
    tentative: u32,        // tentative collisions made
}

fn fly(origin: vec3<f32>, direction: vec3<f32>, key: vec2<u32>) -> Flight {
    let l = line(origin, direction);
    let leave = inside(l, frame.extent).y;
    let mean_free_path = 1.0 / frame.majorant;
    var history = vec2<u32>(0u);
    var tentative = 0u;
    var t_in = 0.0;
    var w = walk_begin(l, 0.0, frame.cell_mm, frame.cells);
    loop {
        let t_out = min(walk_leave(w), leave);
        let cell = cell_index(w.cell);
        var vacant = false;
        @if(skip) {
            let mask = cell_masks[cell];
            vacant = all((mask & frame.opaque_bins) == vec2<u32>(0u));
            if vacant {
                @if(history) { history |= mask; }
            }
        }
        if !vacant {
            var t = t_in;
            for (var j = 0u; ; j++) {
                let words = pcg4d(vec4<u32>(key, cell, j));
                t += exponential(unit(words.x)) * mean_free_path;
                if t >= t_out { break; }
                tentative++;
                let entry = entry_at(origin + direction * t);
                let o = optics[entry];
                @if(history) { history |= bin_bit(o.bin); }
                if unit(words.y) * frame.majorant < o.extinction {
                    return Flight(t, entry, true, history, tentative);
                }
            }
        }
        t_in = max(t_out, t_in);
        if t_out >= leave || !walk_step(&w, l, frame.cell_mm, frame.cells) { break; }
    }
    return Flight(max(leave, 0.0), 0u, false, history, tentative);
}
