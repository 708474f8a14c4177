//! conv2d 3x3 (stride 1 or 2, pad 1), f32 NCHW, forward / input gradient / weight gradient.
//! One generic kernel per pass, instantiated for AVX-512, AVX2+FMA and a portable fallback.
use rayon::prelude::*;
use std::cell::RefCell;

// ---------------------------------------------------------------- SIMD abstraction
/// # Safety
/// Every method may only be called inside a function compiled with the features of the type.
pub trait Simd: Copy {
    type V: Copy;
    const L: usize;
    unsafe fn zero() -> Self::V;
    unsafe fn splat(x: f32) -> Self::V;
    unsafe fn load(p: *const f32) -> Self::V;
    unsafe fn store(p: *mut f32, v: Self::V);
    unsafe fn fma(a: Self::V, b: Self::V, c: Self::V) -> Self::V;
}
#[derive(Clone, Copy)]
pub struct Portable;
impl Simd for Portable {
    type V = [f32; 8];
    const L: usize = 8;
    #[inline(always)]
    unsafe fn zero() -> [f32; 8] { [0.0; 8] }
    #[inline(always)]
    unsafe fn splat(x: f32) -> [f32; 8] { [x; 8] }
    #[inline(always)]
    unsafe fn load(p: *const f32) -> [f32; 8] { unsafe { *(p as *const [f32; 8]) } }
    #[inline(always)]
    unsafe fn store(p: *mut f32, v: [f32; 8]) { unsafe { *(p as *mut [f32; 8]) = v } }
    #[inline(always)]
    unsafe fn fma(a: [f32; 8], b: [f32; 8], mut c: [f32; 8]) -> [f32; 8] {
        for i in 0..8 { c[i] += a[i] * b[i]; }
        c
    }
}
#[cfg(target_arch = "x86_64")]
mod x86 {
    use std::arch::x86_64::*;
    macro_rules! simd {
        ($n:ident, $v:ty, $l:expr, $z:ident, $s:ident, $ld:ident, $st:ident, $f:ident) => {
            #[derive(Clone, Copy)]
            pub struct $n;
            impl super::Simd for $n {
                type V = $v;
                const L: usize = $l;
                #[inline(always)]
                unsafe fn zero() -> $v { unsafe { $z() } }
                #[inline(always)]
                unsafe fn splat(x: f32) -> $v { unsafe { $s(x) } }
                #[inline(always)]
                unsafe fn load(p: *const f32) -> $v { unsafe { $ld(p) } }
                #[inline(always)]
                unsafe fn store(p: *mut f32, v: $v) { unsafe { $st(p, v) } }
                #[inline(always)]
                unsafe fn fma(a: $v, b: $v, c: $v) -> $v { unsafe { $f(a, b, c) } }
            }
        };
    }
    simd!(Avx512, __m512, 16, _mm512_setzero_ps, _mm512_set1_ps, _mm512_loadu_ps, _mm512_storeu_ps, _mm512_fmadd_ps);
    simd!(Avx2, __m256, 8, _mm256_setzero_ps, _mm256_set1_ps, _mm256_loadu_ps, _mm256_storeu_ps, _mm256_fmadd_ps);
}

#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Isa { Portable, Avx2, Avx512 }
pub fn isa() -> Isa {
    use std::sync::OnceLock;
    static I: OnceLock<Isa> = OnceLock::new();
    *I.get_or_init(|| {
        let want = std::env::var("CONV_ISA").unwrap_or_default();
        #[cfg(target_arch = "x86_64")]
        {
            if is_x86_feature_detected!("avx512f") && (want.is_empty() || want == "avx512") { return Isa::Avx512; }
            if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") && want != "portable" { return Isa::Avx2; }
        }
        Isa::Portable
    })
}
impl Isa {
    fn lanes(self) -> usize { if self == Isa::Avx512 { 16 } else { 8 } }
    fn mr(self) -> usize { if self == Isa::Avx512 { 8 } else { 4 } }
}

// ---------------------------------------------------------------- shapes, scratch
#[derive(Clone, Copy, Debug)]
pub struct Shape { pub n: usize, pub ic: usize, pub oc: usize, pub h: usize, pub w: usize, pub stride: usize }
impl Shape {
    pub fn oh(&self) -> usize { (self.h - 1) / self.stride + 1 }
    pub fn ow(&self) -> usize { (self.w - 1) / self.stride + 1 }
}
#[derive(Clone, Copy)]
#[repr(align(64))]
struct Line(#[allow(dead_code)] [f32; 16]);
#[derive(Default)]
struct Buf(Vec<Line>);
impl Buf {
    fn get(&mut self, n: usize) -> &mut [f32] {
        let l = n.div_ceil(16);
        if self.0.len() < l { self.0.resize(l, Line([0.0; 16])); }
        unsafe { std::slice::from_raw_parts_mut(self.0.as_mut_ptr() as *mut f32, n) }
    }
}
thread_local! { static SCR: RefCell<(Buf, Buf)> = RefCell::default(); }
#[derive(Clone, Copy)]
struct Out(*mut f32);
unsafe impl Send for Out {}
unsafe impl Sync for Out {}
impl Out { fn p(&self) -> *mut f32 { self.0 } }
const L2_BUDGET: usize = 400 << 10;
fn up(a: usize, b: usize) -> usize { a.div_ceil(b) * b }

// ---------------------------------------------------------------- forward / input gradient kernel
/// One tile: MR output channels x NV vectors of consecutive (flat) pixels, `ic` input channels, T taps.
#[inline(always)]
unsafe fn micro<S: Simd, const MR: usize, const NR: usize, const T: usize>(
    ic: usize, x: *const f32, icst: usize, off: &[usize; T], mut w: *const f32, bias: *const f32, first: bool, tile: *const f32,
    dst: *mut f32, ds: usize,
) {
    unsafe {
        let mut acc = [[S::zero(); NR]; MR];
        for m in 0..MR {
            for j in 0..NR { acc[m][j] = if first { S::splat(*bias.add(m)) } else { S::load(tile.add((m * NV + j) * S::L)) }; }
        }
        let mut xc = x;
        for _ in 0..ic {
            for t in 0..T {
                let xp = xc.add(off[t]);
                let mut xv = [S::zero(); NR];
                for j in 0..NR { xv[j] = S::load(xp.add(j * S::L)); }
                for m in 0..MR {
                    let b = S::splat(*w.add(m));
                    for j in 0..NR { acc[m][j] = S::fma(b, xv[j], acc[m][j]); }
                }
                w = w.add(MR);
            }
            xc = xc.add(icst);
        }
        for m in 0..MR { for j in 0..NR { S::store(dst.add(m * ds + j * S::L), acc[m][j]); } }
    }
}
const NV: usize = 3;
/// Output phase: taps (offset in the packed band), packed weights, and where its pixels go.
struct Phase { off: Vec<usize>, wpk: Vec<f32>, py: usize, px: usize }
/// `cin` planes of hi x wi are packed with `split` (1: plain, 2: parity planes); q space is qh x qw;
/// output pixel = (q * up + p) inside ho x wo.
struct Job<'a> { cin: usize, cout: usize, hi: usize, wi: usize, src: &'a [f32], split: usize, lead: usize, qh: usize, qw: usize, up: usize, ho: usize, wo: usize, bias: &'a [f32], out: Out, rb: usize, lay: Lay, phases: Vec<Phase> }
/// Strides of the packed band. Wide rows: [row][channel][wq], narrow maps: [channel][row][wq] so that
/// a tile may run across rows.
#[derive(Clone, Copy, Default)]
struct Lay { flat: bool, wq: usize, prow: usize, cs: usize, rs: usize, rp: usize, cp: usize, len: usize }
impl Lay {
    fn new(flat: bool, cin: usize, qw: usize, rb: usize, split: usize, lead: usize) -> Lay {
        let (wq, prow) = (qw + if flat { 1 } else { 2 }, if split == 2 { rb + 1 } else { rb + 1 + lead });
        let len = cin * split * split * (prow * wq + 1);
        let (p, c) = (prow * wq, cin * wq * split);
        let l = Lay { flat, wq, prow, cs: wq * split, rs: c * split, rp: c, cp: wq, len };
        if flat { Lay { cs: split * split * p + 1, rs: wq, rp: 2 * p, cp: p, ..l } } else { l }
    }
}
#[inline(always)]
fn pack_band(f: &Job, n: usize, y0: usize, pk: &mut [f32]) {
    let (l, wi) = (f.lay, f.wi);
    let wq = l.wq;
    for r in 0..l.prow * f.split {
        let iy = (y0 * f.split + r).wrapping_sub(f.lead);
        for c in 0..f.cin {
            let base = c * l.cs + if f.split == 1 { r * l.rs } else { (r % 2) * l.rp + (r / 2) * l.rs };
            let s = if iy < f.hi { &f.src[((n * f.cin + c) * f.hi + iy) * wi..][..wi] } else { &[] };
            if f.split == 1 {
                let d = &mut pk[base..base + wq];
                d[..f.lead].fill(0.0);
                d[f.lead..f.lead + s.len()].copy_from_slice(s);
                d[f.lead + s.len()..].fill(0.0);
            } else {
                let (a, b) = pk.split_at_mut(base + l.cp);
                let (e, o) = (&mut a[base..base + wq], &mut b[..wq]);
                e[0] = 0.0;
                for (p, (o, e)) in s.chunks_exact(2).zip(o.iter_mut().zip(e[1..].iter_mut())) { *o = p[0]; *e = p[1]; }
                let h = s.len() / 2;
                if s.len() % 2 == 1 { o[h] = s[s.len() - 1]; }
                o[s.len().div_ceil(2)..].fill(0.0);
                e[h + 1..].fill(0.0);
            }
            if l.flat && r == 0 { pk[(c + 1) * l.cs - 1] = 0.0; }
        }
    }
}
/// Copies k floats with whole vectors, the last one overlapping.
#[inline(always)]
unsafe fn copy_run<S: Simd>(s: *const f32, d: *mut f32, k: usize) {
    unsafe {
        if k < S::L {
            for i in 0..k { *d.add(i) = *s.add(i); }
            return;
        }
        let mut i = 0;
        while i + S::L <= k { S::store(d.add(i), S::load(s.add(i))); i += S::L; }
        if i < k { S::store(d.add(k - S::L), S::load(s.add(k - S::L))); }
    }
}
#[inline(always)]
unsafe fn run_phase<S: Simd, const MR: usize, const T: usize>(f: &Job, ph: &Phase, n: usize, y0: usize, rows: usize, pk: &[f32], tiles: &mut [f32]) {
    let (wq, icst) = (f.lay.wq, f.lay.cs);
    let off: &[usize; T] = (&ph.off[..]).try_into().unwrap();
    let step = NV * S::L;
    let nb = f.cout.div_ceil(MR);
    // input channels per pass: the X part of a tile stays in L1
    let blk = (144 / T).min(64).min(f.cin);
    let end = if f.lay.flat { rows * wq } else { f.qw };
    let mut q0 = 0;
    while q0 < end {
        let rem = (end - q0).div_ceil(S::L);
        let take = if rem >= 3 && rem != 4 { 3 } else { rem.min(2) };
        // pieces of output rows this tile covers, without the padding column
        let mut piece = [(0usize, 0usize, 0usize); NV * 16];
        let mut np = 0;
        let (mut q, stop) = (q0, end.min(q0 + take * S::L));
        while q < stop {
            let (y, x) = (q / wq, q % wq);
            let oy = (y0 + y) * f.up + ph.py;
            let ox = x * f.up + ph.px;
            let k = f.qw.saturating_sub(x).min(stop - q);
            let kk = k.min((f.wo + f.up - 1).saturating_sub(ox) / f.up);
            if kk > 0 && oy < f.ho { piece[np] = (q - q0, oy * f.wo + ox, kk); np += 1; }
            q += k.max(1);
        }
        // a tile inside one row goes straight to the output
        let direct = f.up == 1 && np == 1 && piece[0].2 == take * S::L;
        let plane = f.ho * f.wo;
        let mut c0 = 0;
        while c0 < f.cin {
            let c = blk.min(f.cin - c0);
            for ob in 0..nb {
                unsafe {
                    let (x, w) = (pk.as_ptr().add(c0 * icst + q0), ph.wpk.as_ptr().add((ob * f.cin + c0) * T * MR));
                    let (b, t) = (f.bias.as_ptr().add(ob * MR), tiles.as_mut_ptr().add(ob * MR * step));
                    let go = direct && c0 + c == f.cin && (ob + 1) * MR <= f.cout;
                    let (d, ds) = if go { (f.out.p().add((n * f.cout + ob * MR) * plane + piece[0].1), plane) } else { (t, step) };
                    match take {
                        3 => micro::<S, MR, 3, T>(c, x, icst, off, w, b, c0 == 0, t, d, ds),
                        2 => micro::<S, MR, 2, T>(c, x, icst, off, w, b, c0 == 0, t, d, ds),
                        _ => micro::<S, MR, 1, T>(c, x, icst, off, w, b, c0 == 0, t, d, ds),
                    }
                }
            }
            c0 += c;
        }
        for o in if direct { f.cout / MR * MR } else { 0 }..f.cout {
            unsafe {
                let t = tiles.as_ptr().add(o * step);
                let d = f.out.p().add((n * f.cout + o) * f.ho * f.wo);
                for &(a, b, k) in &piece[..np] {
                    if f.up == 1 { copy_run::<S>(t.add(a), d.add(b), k) } else { for i in 0..k { *d.add(b + 2 * i) = *t.add(a + i); } }
                }
            }
        }
        q0 += take * S::L;
    }
}
#[inline(always)]
unsafe fn band<S: Simd, const MR: usize>(f: &Job, n: usize, y0: usize, rows: usize, bufs: &mut (Buf, Buf)) {
    let pk = bufs.0.get(f.lay.len + 256);
    pack_band(f, n, y0, pk);
    let tiles = bufs.1.get(f.cout.div_ceil(MR) * MR * NV * S::L);
    let strips = if f.lay.flat { 1 } else { rows };
    for y in 0..strips {
        let (pk, y, rows) = (&pk[y * f.lay.rs..], y0 + y, rows / strips);
        for ph in &f.phases {
            unsafe {
                match ph.off.len() {
                    9 => run_phase::<S, MR, 9>(f, ph, n, y, rows, pk, tiles),
                    4 => run_phase::<S, MR, 4>(f, ph, n, y, rows, pk, tiles),
                    2 => run_phase::<S, MR, 2>(f, ph, n, y, rows, pk, tiles),
                    _ => run_phase::<S, MR, 1>(f, ph, n, y, rows, pk, tiles),
                }
            }
        }
    }
}
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
unsafe fn band_512(f: &Job, n: usize, y0: usize, r: usize, b: &mut (Buf, Buf)) { unsafe { band::<x86::Avx512, 8>(f, n, y0, r, b) } }
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
unsafe fn band_256(f: &Job, n: usize, y0: usize, r: usize, b: &mut (Buf, Buf)) { unsafe { band::<x86::Avx2, 4>(f, n, y0, r, b) } }


fn run(mut f: Job, n: usize, phases: impl FnOnce(&Lay) -> Vec<Phase>) -> Vec<f32> {
    let isa = isa();
    let len = n * f.cout * f.ho * f.wo;
    let mut out: Vec<f32> = Vec::with_capacity(len);
    f.out = Out(out.as_mut_ptr());
    let th = rayon::current_num_threads();
    let flat = f.qw < 48 && f.qw != 32;
    let row = f.cin * f.split * f.split * (f.qw + 2) * 4;
    let mut nb = f.qh.div_ceil((L2_BUDGET / row).saturating_sub(2).clamp(1, f.qh));
    if nb + th <= f.qh { nb = (n * nb).next_multiple_of(th).div_ceil(n); }
    f.rb = f.qh.div_ceil(nb);
    let nb = f.qh.div_ceil(f.rb);
    f.lay = Lay::new(flat, f.cin, f.qw, f.rb, f.split, f.lead);
    f.phases = phases(&f.lay);
    (0..n * nb).into_par_iter().for_each(|t| {
        let (n, y0) = (t / nb, (t % nb) * f.rb);
        let rows = f.rb.min(f.qh - y0);
        SCR.with_borrow_mut(|b| unsafe {
            match isa {
                #[cfg(target_arch = "x86_64")]
                Isa::Avx512 => band_512(&f, n, y0, rows, b),
                #[cfg(target_arch = "x86_64")]
                Isa::Avx2 => band_256(&f, n, y0, rows, b),
                _ => band::<Portable, 4>(&f, n, y0, rows, b),
            }
        });
    });
    unsafe { out.set_len(len) };
    out
}
/// Weights as [cout block][cin][tap][MR]; `so` / `si`: stride of an output / input channel in `w`.
fn pack_w(w: &[f32], cout: usize, cin: usize, so: usize, si: usize, taps: &[usize]) -> Vec<f32> {
    let (mr, nt) = (isa().mr(), taps.len());
    let mut pk = vec![0f32; up(cout, mr) * cin * nt];
    pk.par_chunks_exact_mut(cin * nt * mr).enumerate().for_each(|(ob, blk)| {
        for m in 0..mr.min(cout - ob * mr) {
            for (i, d) in blk.chunks_exact_mut(nt * mr).enumerate() {
                let src = &w[(ob * mr + m) * so + i * si..][..9];
                for (t, &k) in taps.iter().enumerate() { d[t * mr + m] = src[k]; }
            }
        }
    });
    pk
}
pub fn forward(s: Shape, x: &[f32], w: &[f32], bias: Option<&[f32]>) -> Vec<f32> {
    assert!(x.len() == s.n * s.ic * s.h * s.w && w.len() == s.oc * s.ic * 9);
    let mut bb = vec![0f32; up(s.oc, isa().mr())];
    if let Some(b) = bias { bb[..s.oc].copy_from_slice(b); }
    let (qh, qw) = (s.oh(), s.ow());
    let f = Job { cin: s.ic, cout: s.oc, hi: s.h, wi: s.w, src: x, split: s.stride, lead: 1, qh, qw, up: 1, ho: qh, wo: qw, bias: &bb, out: Out(std::ptr::null_mut()), rb: 0, lay: Lay::default(), phases: vec![] };
    run(f, s.n, |l| {
        let off = (0..9).map(|t| if s.stride == 1 { (t / 3) * l.rs + t % 3 } else { (t / 3 % 2) * l.rp + (t / 3 / 2) * l.rs + (t % 3 % 2) * l.cp + t % 3 / 2 }).collect();
        vec![Phase { off, wpk: pack_w(w, s.oc, s.ic, s.ic * 9, 9, &[0, 1, 2, 3, 4, 5, 6, 7, 8]), py: 0, px: 0 }]
    })
}
/// Stride 1: the forward kernel with the weights transposed and flipped. Stride 2: four phases of 1, 2, 2, 4 taps.
pub fn input_grad(s: Shape, dy: &[f32], w: &[f32]) -> Vec<f32> {
    assert!(dy.len() == s.n * s.oc * s.oh() * s.ow() && w.len() == s.oc * s.ic * 9);
    let bb = vec![0f32; up(s.ic, isa().mr())];
    let (qh, qw) = (s.oh(), s.ow());
    let f = Job { cin: s.oc, cout: s.ic, hi: qh, wi: qw, src: dy, split: 1, lead: if s.stride == 1 { 1 } else { 0 }, qh, qw, up: s.stride, ho: s.h, wo: s.w, bias: &bb, out: Out(std::ptr::null_mut()), rb: 0, lay: Lay::default(), phases: vec![] };
    run(f, s.n, |l| {
        let wt = |taps: Vec<usize>| pack_w(w, s.ic, s.oc, 9, s.ic * 9, &taps);
        if s.stride == 1 {
            return vec![Phase { off: (0..9).map(|t| (t / 3) * l.rs + t % 3).collect(), wpk: wt((0..9).rev().collect()), py: 0, px: 0 }];
        }
        // (kernel index, source shift) that reach an even / odd output coordinate
        let k: [&[(usize, usize)]; 2] = [&[(1, 0)], &[(0, 1), (2, 0)]];
        (0..4).map(|p| {
            let (py, px) = (p / 2, p % 2);
            let taps: Vec<_> = k[py].iter().flat_map(|a| k[px].iter().map(move |b| (*a, *b))).collect();
            Phase { off: taps.iter().map(|(a, b)| a.1 * l.rs + b.1).collect(), wpk: wt(taps.iter().map(|(a, b)| a.0 * 3 + b.0).collect()), py, px }
        }).collect()
    })
}

// ---------------------------------------------------------------- weight gradient
/// MR output channels x 3 kernel columns x L input channels, summed over rows x ow pixels.
#[inline(always)]
#[allow(clippy::too_many_arguments)]
unsafe fn micro_wg<S: Simd, const MR: usize>(
    rows: usize, ow: usize, x: *const f32, xrow: usize, xpix: usize, dy: *const f32, dyrow: usize, acc: *mut f32,
) {
    unsafe {
        let mut a = [[S::zero(); 3]; MR];
        for m in 0..MR { for k in 0..3 { a[m][k] = S::load(acc.add((m * 3 + k) * S::L)); } }
        for r in 0..rows {
            let mut xp = x.add(r * xrow);
            let mut d = dy.add(r * dyrow);
            for _ in 0..ow {
                let mut xv = [S::zero(); 3];
                for k in 0..3 { xv[k] = S::load(xp.add(k * S::L)); }
                for m in 0..MR {
                    let b = S::splat(*d.add(m));
                    for k in 0..3 { a[m][k] = S::fma(b, xv[k], a[m][k]); }
                }
                xp = xp.add(xpix);
                d = d.add(MR);
            }
        }
        for m in 0..MR { for k in 0..3 { S::store(acc.add((m * 3 + k) * S::L), a[m][k]); } }
    }
}
/// src: C rows of `w` floats, `plane` apart -> dst[block][lead + w + tail][B], channels padded with zeros.
#[inline(always)]
fn pack_t<const B: usize>(src: &[f32], plane: usize, c: usize, w: usize, dst: &mut [f32], lead: usize, bl: usize) {
    for cb in 0..c.div_ceil(B) {
        let d = &mut dst[cb * bl * B..(cb + 1) * bl * B];
        d[..lead * B].fill(0.0);
        d[(lead + w) * B..].fill(0.0);
        let d = &mut d[lead * B..(lead + w) * B];
        if (cb + 1) * B <= c {
            let rows: [&[f32]; B] = std::array::from_fn(|i| &src[(cb * B + i) * plane..][..w]);
            for x in 0..w {
                let o: &mut [f32; B] = (&mut d[x * B..(x + 1) * B]).try_into().unwrap();
                for i in 0..B { o[i] = rows[i][x]; }
            }
        } else {
            for x in 0..w { for i in 0..B { d[x * B + i] = if cb * B + i < c { src[(cb * B + i) * plane + x] } else { 0.0 }; } }
        }
    }
}
struct Wg<'a> { s: Shape, x: &'a [f32], dy: &'a [f32] }
#[inline(always)]
unsafe fn wg_chunk<S: Simd, const MR: usize, const L: usize>(g: &Wg, n: usize, y0: usize, y1: usize, acc: &mut [f32], bufs: &mut (Buf, Buf)) {
    let Shape { ic, oc, h, w, stride, .. } = g.s;
    let (oh, ow) = (g.s.oh(), g.s.ow());
    let (icb, ocb) = (ic.div_ceil(L), oc.div_ceil(MR));
    let xw = w + 3;
    let xrow = icb * xw * L;
    let dyrow = ocb * ow * MR;
    let rows = y1 - y0;
    let nrows = (rows - 1) * stride + 3;
    let xb = bufs.0.get(nrows * xrow);
    for r in 0..nrows {
        let iy = (y0 * stride + r).wrapping_sub(1);
        let d = &mut xb[r * xrow..(r + 1) * xrow];
        if iy >= h { d.fill(0.0) } else { pack_t::<L>(&g.x[n * ic * h * w + iy * w..], h * w, ic, w, d, 1, xw) }
    }
    let db = bufs.1.get(rows * dyrow);
    for r in 0..rows {
        pack_t::<MR>(&g.dy[n * oc * oh * ow + (y0 + r) * ow..], oh * ow, oc, ow, &mut db[r * dyrow..(r + 1) * dyrow], 0, ow);
    }
    for ib in 0..icb {
        for kh in 0..3 {
            for ob in 0..ocb {
                unsafe {
                    micro_wg::<S, MR>(
                        rows, ow,
                        xb.as_ptr().add(kh * xrow + ib * xw * L), xrow * stride, stride * L,
                        db.as_ptr().add(ob * ow * MR), dyrow,
                        acc.as_mut_ptr().add(((ib * 3 + kh) * ocb + ob) * 3 * MR * L),
                    )
                }
            }
        }
    }
}
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
unsafe fn wg_chunk_512(g: &Wg, n: usize, y0: usize, y1: usize, acc: &mut [f32], b: &mut (Buf, Buf)) { unsafe { wg_chunk::<x86::Avx512, 8, 16>(g, n, y0, y1, acc, b) } }
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
unsafe fn wg_chunk_256(g: &Wg, n: usize, y0: usize, y1: usize, acc: &mut [f32], b: &mut (Buf, Buf)) { unsafe { wg_chunk::<x86::Avx2, 4, 8>(g, n, y0, y1, acc, b) } }

pub fn weight_grad(s: Shape, x: &[f32], dy: &[f32]) -> Vec<f32> {
    assert!(x.len() == s.n * s.ic * s.h * s.w && dy.len() == s.n * s.oc * s.oh() * s.ow());
    let isa = isa();
    let (l, mr) = (isa.lanes(), isa.mr());
    let (icb, ocb) = (s.ic.div_ceil(l), s.oc.div_ceil(mr));
    let alen = icb * ocb * 9 * mr * l;
    let g = Wg { s, x, dy };
    let (oh, ow) = (s.oh(), s.ow());
    let bytes = 4 * (icb * l * (s.w + 3) * s.stride + ocb * mr * ow);
    let r = (L2_BUDGET / bytes).saturating_sub(1).clamp(1, oh);
    let total = s.n * oh;
    let parts = rayon::current_num_threads().min(total);
    let accs: Vec<Vec<f32>> = (0..parts).into_par_iter().map(|p| {
        let mut acc = vec![0f32; alen];
        let (mut a, b) = (p * total / parts, (p + 1) * total / parts);
        SCR.with_borrow_mut(|bufs| {
            while a < b {
                let (n, y0) = (a / oh, a % oh);
                let y1 = (y0 + r).min(oh).min(y0 + b - a);
                unsafe {
                    match isa {
                        #[cfg(target_arch = "x86_64")]
                        Isa::Avx512 => wg_chunk_512(&g, n, y0, y1, &mut acc, bufs),
                        #[cfg(target_arch = "x86_64")]
                        Isa::Avx2 => wg_chunk_256(&g, n, y0, y1, &mut acc, bufs),
                        _ => wg_chunk::<Portable, 4, 8>(&g, n, y0, y1, &mut acc, bufs),
                    }
                }
                a += y1 - y0;
            }
        });
        acc
    }).collect();
    let mut dw = vec![0f32; s.oc * s.ic * 9];
    for o in 0..s.oc {
        for i in 0..s.ic {
            for kh in 0..3 {
                let base = ((((i / l) * 3 + kh) * ocb + o / mr) * mr + o % mr) * 3 * l + i % l;
                for kw in 0..3 {
                    let mut v = 0.0;
                    for a in &accs { v += a[base + kw * l]; }
                    dw[(o * s.ic + i) * 9 + kh * 3 + kw] = v;
                }
            }
        }
    }
    dw
}

