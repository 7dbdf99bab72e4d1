//! First contact in exact integer arithmetic: an obvious and slow judge, which shares no formula with the solver.
//!
//! The corners D(t) of the convex set of differences (a triangle for point and triangle, a parallelogram for two
//! edges) have integer coordinates at both ends. The set holds the origin if an edge of it does (D_k × D_l = 0 and
//! D_k · D_l ≤ 0), or its inside does (the determinant is zero, the weights are not negative, the normal is not
//! zero). These are polynomials in t with integer Bernstein coefficients; halving the interval is adding and
//! shifting. Halves in which some condition fails throughout are dropped, the first that is left after [`DEPTH`]
//! halvings is the answer. Whatever cannot be told apart by then counts as a contact.

/// Halvings of [0, 1]: the times are known to 1.4e-17.
const DEPTH: u32 = 56;

/// 64-bit limbs: 4 · 56 bits for the halvings of a quartic, 94 for its coefficients at coordinates of 2²⁰, and room.
const LIMBS: usize = 6;

/// A signed integer of 384 bits, two's complement, least limb first.
#[derive(Clone, Copy, Default)]
struct Int([u64; LIMBS]);

impl Int {
    fn new(value: i128) -> Self {
        let mut limbs = [if value < 0 { u64::MAX } else { 0 }; LIMBS];
        (limbs[0], limbs[1]) = (value as u64, (value >> 64) as u64);
        Self(limbs)
    }

    fn plus(mut self, other: &Self) -> Self {
        let mut carry = false;
        for (a, b) in self.0.iter_mut().zip(other.0) {
            let (sum, over) = a.overflowing_add(b);
            let (sum, again) = sum.overflowing_add(u64::from(carry));
            (*a, carry) = (sum, over || again);
        }
        self
    }

    fn doubled(self) -> Self {
        self.plus(&self)
    }

    fn sign(&self) -> i32 {
        if self.0[LIMBS - 1] >> 63 == 1 { -1 } else { i32::from(self.0 != [0; LIMBS]) }
    }
}

/// A polynomial in t by its power coefficients.
#[derive(Clone)]
struct Powers(Vec<i128>);

impl Powers {
    fn plus(&self, other: &Self, factor: i128) -> Self {
        let term = |p: &Self, i: usize| p.0.get(i).copied().unwrap_or(0);
        let length = self.0.len().max(other.0.len());
        Self((0..length).map(|i| term(self, i) + factor * term(other, i)).collect())
    }

    fn times(&self, other: &Self) -> Self {
        let mut product = vec![0; self.0.len() + other.0.len() - 1];
        for (i, a) in self.0.iter().enumerate() {
            for (k, b) in other.0.iter().enumerate() {
                product[i + k] += a * b;
            }
        }
        Self(product)
    }

    fn is_zero(&self) -> bool {
        self.0.iter().all(|&c| c == 0)
    }
}

/// A vector of polynomials.
type Path = [Powers; 3];

fn cross(a: &Path, b: &Path) -> Path {
    [(1, 2), (2, 0), (0, 1)].map(|(i, k)| a[i].times(&b[k]).plus(&a[k].times(&b[i]), -1))
}

fn dot(a: &Path, b: &Path) -> Powers {
    (0..3).map(|i| a[i].times(&b[i])).reduce(|sum, term| sum.plus(&term, 1)).expect("three terms")
}

fn minus(a: &Path, b: &Path) -> Path {
    [0, 1, 2].map(|i| a[i].plus(&b[i], -1))
}

/// Bernstein coefficients on an interval, up to a positive factor.
#[derive(Clone)]
struct Bernstein {
    b: [Int; 5],
    degree: usize,
}

impl Bernstein {
    fn new(p: &Powers) -> Self {
        let degree = p.0.len() - 1;
        let choose = |n: usize, k: usize| (0..k).fold(1i128, |c, i| c * (n - i) as i128 / (i as i128 + 1));
        // The factor 12 makes every i over k divided by n over k an integer for degrees up to 4.
        let coefficient = |i: usize| (0..=i).map(|k| 12 * choose(i, k) / choose(degree, k) * p.0[k]).sum::<i128>();
        let exact = |i: usize| (0..=i).all(|k| 12 * choose(i, k) % choose(degree, k) == 0);
        assert!((0..=degree).all(exact), "the factor makes integers");
        let mut b = [Int::default(); 5];
        (0..=degree).for_each(|i| b[i] = Int::new(coefficient(i)));
        Self { b, degree }
    }

    /// Left and right half, by de Casteljau's scheme with sums in place of means.
    fn halves(&self) -> [Self; 2] {
        let n = self.degree;
        let (mut left, mut right, mut row) = (self.clone(), self.clone(), self.b);
        for level in 0..=n {
            // Sums of level `level` are 2^level times the means.
            let scaled = |value: Int| (level..n).fold(value, |v, _| v.doubled());
            left.b[level] = scaled(row[0]);
            right.b[n - level] = scaled(row[n - level]);
            (0..n - level).for_each(|i| row[i] = row[i].plus(&row[i + 1]));
        }
        [left, right]
    }

    fn all(&self, sign: i32) -> bool {
        self.b[..=self.degree].iter().all(|b| b.sign() == sign)
    }
}

/// One way to touch: these are zero, those not negative, and not all of the last are zero.
#[derive(Clone)]
struct Way {
    zero: Vec<Bernstein>,
    not_negative: Vec<Bernstein>,
    not_all_zero: Vec<Bernstein>,
}

impl Way {
    fn new(zero: &[Powers], not_negative: &[Powers], not_all_zero: &[Powers]) -> Option<Self> {
        if !not_all_zero.is_empty() && not_all_zero.iter().all(Powers::is_zero) {
            return None;
        }
        let bernstein = |list: &[Powers]| list.iter().map(Bernstein::new).collect();
        // What is zero all the time says nothing and never fails.
        let zero: Vec<Powers> = zero.iter().filter(|p| !p.is_zero()).cloned().collect();
        Some(Self {
            zero: bernstein(&zero),
            not_negative: bernstein(not_negative),
            not_all_zero: bernstein(not_all_zero),
        })
    }

    fn possible(&self) -> bool {
        !self.zero.iter().any(|p| p.all(1) || p.all(-1)) && !self.not_negative.iter().any(|p| p.all(-1))
    }

    fn halves(&self) -> [Self; 2] {
        let half = |list: &[Bernstein]| list.iter().map(Bernstein::halves).map(|[left, right]| (left, right)).unzip();
        let ((zero, zero_right), (not_negative, not_negative_right)) = (half(&self.zero), half(&self.not_negative));
        let (not_all_zero, not_all_zero_right) = half(&self.not_all_zero);
        [
            Self { zero, not_negative, not_all_zero },
            Self { zero: zero_right, not_negative: not_negative_right, not_all_zero: not_all_zero_right },
        ]
    }

    /// End of the first interval of length 2^-DEPTH in which this way may touch, if that is before `best`, in those
    /// units.
    fn first(&self, start: u64, depth: u32, best: u64) -> Option<u64> {
        let length = 1 << (DEPTH - depth);
        if start >= best || !self.possible() {
            return None;
        }
        if depth == DEPTH {
            // Where the normal vanishes there is no inside, and the edges answer.
            let flat = !self.not_all_zero.is_empty() && !self.not_all_zero.iter().any(|p| p.all(1) || p.all(-1));
            return (!flat).then_some(start + length);
        }
        let [left, right] = self.halves();
        left.first(start, depth + 1, best).or_else(|| right.first(start + length / 2, depth + 1, best))
    }
}

/// Time of first contact, or up to 2^-56 later, or `None`. `start`, `end`: integer coordinates up to 2²⁰ of the
/// differences of the corners: three of point and triangle, or a0 − b0, a0 − b1, a1 − b0, a1 − b1 of two edges.
pub(super) fn first_contact(start: &[[i64; 3]], end: &[[i64; 3]]) -> Option<f64> {
    let d: Vec<Path> = start
        .iter()
        .zip(end)
        .map(|(s, e)| [0, 1, 2].map(|i| Powers(vec![i128::from(s[i]), i128::from(e[i] - s[i])])))
        .collect();
    let borders: &[[usize; 2]] =
        if d.len() == 3 { &[[0, 1], [1, 2], [2, 0]] } else { &[[0, 1], [0, 2], [1, 3], [2, 3]] };
    let mut ways: Vec<Way> = borders
        .iter()
        .filter_map(|&[k, l]| {
            let behind = Powers(vec![0]).plus(&dot(&d[k], &d[l]), -1);
            Way::new(&cross(&d[k], &d[l]), &[behind], &[])
        })
        .collect();
    let (u, v) = (minus(&d[1], &d[0]), minus(&d[2], &d[0]));
    let normal = cross(&u, &v);
    let volume = dot(&d[0], &normal);
    let weights = if d.len() == 3 {
        [(1, 2), (2, 0), (0, 1)].map(|(k, l)| dot(&normal, &cross(&d[k], &d[l]))).to_vec()
    } else {
        // D0 + α u + β v = 0 gives α |n|² = (v × D0) · n and β |n|² = (D0 × u) · n.
        let square = dot(&normal, &normal);
        let (alpha, beta) = (dot(&cross(&v, &d[0]), &normal), dot(&cross(&d[0], &u), &normal));
        vec![square.plus(&alpha, -1), square.plus(&beta, -1), alpha, beta]
    };
    ways.extend(Way::new(&[volume], &weights, &normal));
    let mut best = u64::MAX;
    for way in &ways {
        best = way.first(0, 0, best).unwrap_or(best);
    }
    (best < u64::MAX).then(|| best as f64 / (1u64 << DEPTH) as f64)
}
