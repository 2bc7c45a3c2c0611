// Walking a straight line through the cells of a regular grid: macro-cells,
// voxels, or cells of the light field.

struct Walk {
    cell: vec3<i32>,
    // ray parameter at which each axis leaves the cell
    next: vec3<f32>,
}

const FAR: f32 = 1e30;

struct Line {
    origin: vec3<f32>,
    direction: vec3<f32>,
    inverse: vec3<f32>,
}

fn line(origin: vec3<f32>, direction: vec3<f32>) -> Line {
    let small = abs(direction) < vec3<f32>(1e-12);
    return Line(origin, direction, select(1.0 / direction, vec3<f32>(FAR), small));
}

// Every boundary is found from its index, never by adding steps, so that a walk
// begun in the middle of a line meets the same numbers.
fn walk_next(l: Line, cell: vec3<i32>, edge: vec3<f32>) -> vec3<f32> {
    let boundary = vec3<f32>(cell + vec3<i32>(l.direction > vec3<f32>(0.0))) * edge;
    return select((boundary - l.origin) * l.inverse, vec3<f32>(FAR), l.inverse == vec3<f32>(FAR));
}

fn walk_begin(l: Line, t: f32, edge: vec3<f32>, cells: vec3<u32>) -> Walk {
    let at = vec3<i32>(floor((l.origin + l.direction * t) / edge));
    let cell = clamp(at, vec3<i32>(0), vec3<i32>(cells) - 1);
    return Walk(cell, walk_next(l, cell, edge));
}

fn walk_leave(w: Walk) -> f32 {
    return min(w.next.x, min(w.next.y, w.next.z));
}

// Steps into the neighbouring cell; false if the line leaves the grid.
fn walk_step(w: ptr<function, Walk>, l: Line, edge: vec3<f32>, cells: vec3<u32>) -> bool {
    let leave = walk_leave(*w);
    var move_by = vec3<i32>(0);
    if (*w).next.x <= leave {
        move_by.x = select(-1, 1, l.direction.x > 0.0);
    } else if (*w).next.y <= leave {
        move_by.y = select(-1, 1, l.direction.y > 0.0);
    } else {
        move_by.z = select(-1, 1, l.direction.z > 0.0);
    }
    (*w).cell += move_by;
    (*w).next = walk_next(l, (*w).cell, edge);
    return all((*w).cell >= vec3<i32>(0)) && all((*w).cell < vec3<i32>(cells));
}

// Ray parameters between which a line is inside the box from 0 to `extent`; empty if x >= y.
fn inside(l: Line, extent: vec3<f32>) -> vec2<f32> {
    let parallel = l.inverse == vec3<f32>(FAR);
    let outside = any(parallel & ((l.origin < vec3<f32>(0.0)) | (l.origin > extent)));
    let a = -l.origin * l.inverse;
    let b = (extent - l.origin) * l.inverse;
    let near = select(min(a, b), vec3<f32>(-FAR), parallel);
    let far = select(max(a, b), vec3<f32>(FAR), parallel);
    let span = vec2(max(max(near.x, near.y), max(near.z, 0.0)), min(far.x, min(far.y, far.z)));
    return select(span, vec2<f32>(0.0), outside);
}
