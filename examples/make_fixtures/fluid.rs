//! A small gas on a grid, for flames and smoke: semi-Lagrangian advection (Stam 1999) with the MacCormack correction
//! (Selle et al. 2008), buoyancy, vorticity confinement (Fedkiw et al. 2001), red-black over-relaxation for pressure.

use enliven::base::par;

/// Velocity in cells per frame and two carried quantities, all at cell centres.
pub struct Gas {
    /// Cells in a row.
    pub width: usize,
    /// Rows of cells; row 0 is the top.
    pub height: usize,
    /// Rightward velocity.
    pub u: Vec<f32>,
    /// Downward velocity.
    pub v: Vec<f32>,
    /// Heat.
    pub heat: Vec<f32>,
    /// Soot or fuel, as the caller likes.
    pub soot: Vec<f32>,
    pressure: Vec<f32>,
}

impl Gas {
    /// Still air.
    pub fn still(width: usize, height: usize) -> Self {
        let zeros = || vec![0.0; width * height];
        Self { width, height, u: zeros(), v: zeros(), heat: zeros(), soot: zeros(), pressure: zeros() }
    }

    /// Moves everything along the velocity, and up by `draught` cells per frame, for `dt` frames.
    pub fn advect(&mut self, draught: f32, dt: f32) {
        let (u, v) = (self.u.clone(), self.v.iter().map(|v| v - draught).collect::<Vec<_>>());
        let move_one = |q: &[f32]| self.carried(q, &u, &v, dt);
        let (a, b) = par::join(
            || par::join(|| move_one(&self.u), || move_one(&self.v)),
            || par::join(|| move_one(&self.heat), || move_one(&self.soot)),
        );
        (self.u, self.v) = a;
        (self.heat, self.soot) = b;
    }

    fn carried(&self, q: &[f32], u: &[f32], v: &[f32], dt: f32) -> Vec<f32> {
        let (w, h) = (self.width, self.height);
        let forward = self.traced(q, u, v, dt);
        let back = self.traced(&forward, u, v, -dt);
        (0..w * h)
            .map(|i| {
                let (x, y) = ((i % w) as f32 - dt * u[i], (i / w) as f32 - dt * v[i]);
                let (low, high) = self.neighbourhood(q, x, y);
                (forward[i] + 0.5 * (q[i] - back[i])).clamp(low, high)
            })
            .collect()
    }

    fn traced(&self, q: &[f32], u: &[f32], v: &[f32], dt: f32) -> Vec<f32> {
        let w = self.width;
        (0..q.len()).map(|i| self.sample(q, (i % w) as f32 - dt * u[i], (i / w) as f32 - dt * v[i])).collect()
    }

    fn corner(&self, x: f32, y: f32) -> (usize, f32, f32) {
        let x = x.clamp(0.0, self.width as f32 - 1.001);
        let y = y.clamp(0.0, self.height as f32 - 1.001);
        (y as usize * self.width + x as usize, x - x.floor(), y - y.floor())
    }

    /// Bilinear value of `q` at (x, y) in cells (centres at whole numbers).
    pub fn sample(&self, q: &[f32], x: f32, y: f32) -> f32 {
        let (i, ax, ay) = self.corner(x, y);
        let w = self.width;
        let top = q[i] + (q[i + 1] - q[i]) * ax;
        let bottom = q[i + w] + (q[i + w + 1] - q[i + w]) * ax;
        top + (bottom - top) * ay
    }

    fn neighbourhood(&self, q: &[f32], x: f32, y: f32) -> (f32, f32) {
        let (i, _, _) = self.corner(x, y);
        let four = [q[i], q[i + 1], q[i + self.width], q[i + self.width + 1]];
        (four.into_iter().fold(f32::MAX, f32::min), four.into_iter().fold(f32::MIN, f32::max))
    }

    /// `f(cell)` for every cell that has all four neighbours, 0 at the border.
    fn inside(&self, f: impl Fn(usize) -> f32) -> Vec<f32> {
        let (w, h) = (self.width, self.height);
        let border = |i: usize| i.is_multiple_of(w) || i % w == w - 1 || i < w || i / w == h - 1;
        (0..w * h).map(|i| if border(i) { 0.0 } else { f(i) }).collect()
    }

    /// Hot gas rises: `lift` cells per frame² at heat 1, less `weight` at soot 1.
    pub fn rise(&mut self, lift: f32, weight: f32, dt: f32) {
        for ((v, heat), soot) in self.v.iter_mut().zip(&self.heat).zip(&self.soot) {
            *v -= dt * (lift * heat - weight * soot);
        }
    }

    /// Gives small vortices back what the grid took from them.
    pub fn confine(&mut self, strength: f32, dt: f32) {
        let (w, h) = (self.width, self.height);
        let (u, v) = (&self.u, &self.v);
        let curl = self.inside(|i| 0.5 * (v[i + 1] - v[i - 1] - u[i + w] + u[i - w]));
        for y in 2..h - 2 {
            for i in y * w + 2..y * w + w - 2 {
                let gx = curl[i + 1].abs() - curl[i - 1].abs();
                let gy = curl[i + w].abs() - curl[i - w].abs();
                let norm = strength * dt / ((gx * gx + gy * gy).sqrt() + 1e-4);
                self.u[i] += norm * gy * curl[i];
                self.v[i] -= norm * gx * curl[i];
            }
        }
    }

    /// Makes the velocity free of divergence; open at the top and the sides, a floor at the bottom.
    pub fn project(&mut self, sweeps: usize) {
        let (w, h) = (self.width, self.height);
        let (u, v) = (&self.u, &self.v);
        let divergence = self.inside(|i| 0.5 * (u[i + 1] - u[i - 1] + v[i + w] - v[i - w]));
        let p = &mut self.pressure;
        for sweep in 0..2 * sweeps {
            for y in 1..h - 1 {
                let first = 1 + (y + sweep) % 2;
                for i in (y * w + first..y * w + w - 1).step_by(2) {
                    let next = 0.25 * (p[i - 1] + p[i + 1] + p[i - w] + p[i + w] - divergence[i]);
                    p[i] += 1.86 * (next - p[i]);
                }
            }
            let (floor, above) = ((h - 1) * w, (h - 2) * w);
            p.copy_within(above..above + w, floor);
        }
        for y in 1..h - 1 {
            for i in y * w + 1..y * w + w - 1 {
                self.u[i] -= 0.5 * (self.pressure[i + 1] - self.pressure[i - 1]);
                self.v[i] -= 0.5 * (self.pressure[i + w] - self.pressure[i - w]);
            }
        }
        for x in 0..w {
            self.u[x] = self.u[w + x];
            self.v[x] = self.v[w + x];
            self.v[(h - 1) * w + x] = 0.0;
        }
        for y in 0..h {
            for (edge, inner) in [(y * w, y * w + 1), (y * w + w - 1, y * w + w - 2)] {
                self.u[edge] = self.u[inner];
                self.v[edge] = self.v[inner];
            }
        }
    }
}
