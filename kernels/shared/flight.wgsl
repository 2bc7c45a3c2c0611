// Free flight by marks, H(6) without its march-step bias.
//
// Tentative collisions form a Poisson process of the scene's fixed majorant; each
// carries a mark in [0, 1) and is real where mark * majorant < extinction. The process
// restarts at every macro-cell and is the sum of independent layers, one for each
// octave of marks: layer k has the marks in [2^-(k+1), 2^-k), the last layer all below.
// Draws are keyed by photon, event, cell and layer, so no random point depends on the
// materials; and where a cell's extinction stays below majorant * 2^-k, the layers
// before k need not be drawn at all, since nothing in them could be real.
//
// A flight that was flown before need not be flown whole after an edit: where it passed, only
// those layers can stop it in which the cell has a value that rose above their marks.
//
// A photon's history knows values and marks: the low bits of a bin give way to the class
// of the mark's octave, because a tentative collision of mark m can only turn real where
// extinction rises above m * majorant.

import package::shared::counter::expect;
import package::shared::random::{pcg4d, unit, exponential};
import package::shared::scene::{
    scene, optics_of, layers_of, entry_at, bin_of, bin_bit, cell_index
};
import package::constants::LAYERS;
import package::shared::slot::power_of_two;
import package::shared::walk::{FAR, line, inside, walk_begin, walk_leave, walk_step};

struct Flight {
    distance: f32,         // mm to the collision, or to the exit
    entry: u32,            // the table entry that decided the collision
    collided: bool,
    stands: bool,          // it ends where the known one does; distance and entry are not told
    history: vec2<u32>,    // bins of everything that it relied on, and the known one did
    tentative: u32,        // tentative collisions made
    steps: u32,            // macro-cells entered
}

// What is known of a flight before an edit: it passed `passed` mm and, if that still stops it,
// ended before `ended` mm. Nothing is known of a new flight.
struct Known {
    passed: f32,
    ended: f32,
    history: vec2<u32>,
}

fn nothing_known() -> Known {
    return Known(0.0, FAR, vec2<u32>(0u));
}

fn fly(origin: vec3<f32>, direction: vec3<f32>, key: vec2<u32>, known: Known) -> Flight {
    let l = line(origin, direction);
    let leave = inside(l, scene.extent).y;
    var result = Flight(max(leave, 0.0), 0u, false, false, known.history, 0u, 0u);
    let values = ~(scene.mark_classes - 1u);
    var t_in = 0.0;
    var arrived = false;
    var w = walk_begin(l, 0.0, scene.cell_mm, scene.cells);
    loop {
        var t_out = min(walk_leave(w), leave);
        let cell = cell_index(w.cell);
        result.steps++;
        let here = layers_of(cell);
        var level = 0u;
        @if(skip) { level = here.first; }
        var layers = ((1u << LAYERS) - 1u) & ~((1u << level) - 1u);
        @if(history) {
            let passed = t_out < known.passed;
            result.stands = t_out > known.ended && here.opened == 0u;
            if passed || result.stands { layers &= here.opened; }
            // What is not drawn relied on every value that the cell can have.
            if level > 0u && !passed && !result.stands { result.history |= here.skipped; }
        }
        while layers != 0u {
            let layer = firstTrailingBit(layers);
            layers &= layers - 1u;
            let last = layer == LAYERS - 1u;
            let width = power_of_two(-i32(select(layer + 1u, layer, last)));
            let floor_of_marks = select(width, 0.0, last);
            let mark_class = layer * scene.mark_classes / LAYERS;
            var t = t_in;
            var over = false;
            for (var j = 0u; ; j++) {
                let words = pcg4d(vec4<u32>(key, cell * LAYERS + layer, j));
                t += exponential(unit(words.x)) / (scene.majorant * width);
                over = t >= t_out;
                if over { break; }
                result.tentative++;
                let entry = entry_at(origin + direction * t);
                let o = optics_of(entry);
                @if(history) { result.history |= bin_bit((bin_of(entry) & values) | mark_class); }
                let mark = floor_of_marks + unit(words.y) * width;
                if mark * scene.majorant < o.extinction {
                    // The first real collision of this layer; another may still be nearer.
                    t_out = t;
                    result.distance = t;
                    result.entry = entry;
                    result.collided = true;
                    over = true;
                    break;
                }
            }
            expect(over);
        }
        expect(layers == 0u);
        arrived = result.collided || result.stands;
        if arrived { break; }
        t_in = max(t_out, t_in);
        arrived = t_out >= leave || !walk_step(&w, l, scene.cell_mm, scene.cells);
        if arrived { break; }
    }
    expect(arrived);
    return result;
}
