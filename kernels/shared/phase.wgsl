// The phase function of Henyey and Greenstein, and uniform directions.

const PI: f32 = 3.14159265358979;

// An orthonormal frame around z: Duff et al., "Building an Orthonormal Basis,
// Revisited", JCGT 6(1), 2017.
fn around(z: vec3<f32>, local: vec3<f32>) -> vec3<f32> {
    let s = select(-1.0, 1.0, z.z >= 0.0);
    let a = -1.0 / (s + z.z);
    let b = z.x * z.y * a;
    let x = vec3(1.0 + s * z.x * z.x * a, s * b, -s * z.x);
    let y = vec3(b, s + z.y * z.y * a, -z.y);
    return normalize(x * local.x + y * local.y + z * local.z);
}

fn polar(cosine: f32, turn: f32) -> vec3<f32> {
    let sine = sqrt(max(1.0 - cosine * cosine, 0.0));
    let angle = 2.0 * PI * turn;
    return vec3(sine * cos(angle), sine * sin(angle), cosine);
}

// A direction drawn with density proportional to its cosine with `normal`.
fn cosine_around(normal: vec3<f32>, u: vec2<f32>) -> vec3<f32> {
    return around(normal, polar(sqrt(1.0 - u.x), u.y));
}

fn uniform_direction(u: vec2<f32>) -> vec3<f32> {
    return polar(1.0 - 2.0 * u.x, u.y);
}

// Density over the sphere, 1/sr; the cosine is that between travel before and after.
fn phase(g: f32, cosine: f32) -> f32 {
    let d = 1.0 + g * g - 2.0 * g * cosine;
    return (1.0 - g * g) / (4.0 * PI * d * sqrt(d));
}

fn sample_phase(g: f32, travel: vec3<f32>, u: vec2<f32>) -> vec3<f32> {
    if abs(g) < 1e-3 {
        return uniform_direction(u);
    }
    let s = (1.0 - g * g) / (1.0 - g + 2.0 * g * u.x);
    return around(travel, polar(clamp((1.0 + g * g - s * s) / (2.0 * g), -1.0, 1.0), u.y));
}
