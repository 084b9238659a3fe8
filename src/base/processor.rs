//! Instruction sets beyond the architecture's baseline, detected at run time, and prefetching.

use std::sync::LazyLock;

use super::error::{Error, Result};

/// Environment variable that rules wider instruction sets out, to measure and to test what others have: `portable`, `avx2` or `avx512`.
/// It says so for rays and paths; nothing that is rendered depends on it.
pub const LANES: &str = "FANAL_LANES";

/// Instruction sets, each with those before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Set {
    Portable,
    Avx2,
    Avx512,
}

/// The widest set that may be used; an error for what [`LANES`] does not know.
static WIDEST: LazyLock<std::result::Result<Set, String>> =
    LazyLock::new(|| match std::env::var(LANES).unwrap_or_default().as_str() {
        "portable" => Ok(Set::Portable),
        "avx2" => Ok(Set::Avx2),
        "" | "avx512" => Ok(Set::Avx512),
        other => Err(format!("{LANES} is '{other}'; it can be portable, avx2 or avx512")),
    });

#[cfg(target_arch = "x86_64")]
fn allows(set: Set) -> bool {
    WIDEST.as_ref().is_ok_and(|widest| set <= *widest)
}

/// Checks [`LANES`].
///
/// # Errors
/// [`Error::Options`] where it names no instruction set.
pub fn check() -> Result<()> {
    WIDEST.as_ref().map(|_| ()).map_err(|error| Error::Options(error.clone()))
}

/// Proof that the processor has AVX2, FMA, BMI1, BMI2, LZCNT and POPCNT: only [`Avx2::detect`] makes one.
#[derive(Debug, Clone, Copy)]
pub struct Avx2(());

impl Avx2 {
    /// Detects the instruction sets; none where one of them is missing.
    #[inline(always)]
    pub fn detect() -> Option<Self> {
        #[cfg(target_arch = "x86_64")]
        if allows(Set::Avx2)
            && is_x86_feature_detected!("avx2")
            && is_x86_feature_detected!("fma")
            && is_x86_feature_detected!("bmi1")
            && is_x86_feature_detected!("bmi2")
            && is_x86_feature_detected!("lzcnt")
            && is_x86_feature_detected!("popcnt")
        {
            return Some(Self(()));
        }
        None
    }
}

/// Asks the processor to bring the first cache line of `value` near, since it will be needed soon.
#[inline(always)]
pub fn prefetch<T>(value: &T) {
    prefetch_line(value);
}

/// Asks the processor to bring the cache line at `address` near; one that nothing lies at does no harm.
#[inline(always)]
#[allow(unsafe_code, reason = "the instruction is an intrinsic that asks for a feature")]
pub fn prefetch_line<T>(address: *const T) {
    #[cfg(target_arch = "x86_64")]
    // SAFETY: every x86-64 processor has SSE, and a prefetch changes and faults at nothing.
    unsafe {
        std::arch::x86_64::_mm_prefetch::<{ std::arch::x86_64::_MM_HINT_T0 }>(address.cast());
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = address;
}

/// Proof that the processor has, besides those of [`Avx2`], the parts F, VL, BW and DQ of AVX-512: only [`Avx512::detect`] makes one.
#[derive(Debug, Clone, Copy)]
pub struct Avx512(Avx2);

impl Avx512 {
    /// Detects the instruction sets; none where one of them is missing.
    #[inline(always)]
    pub fn detect() -> Option<Self> {
        #[cfg(target_arch = "x86_64")]
        if allows(Set::Avx512)
            && is_x86_feature_detected!("avx512f")
            && is_x86_feature_detected!("avx512vl")
            && is_x86_feature_detected!("avx512bw")
            && is_x86_feature_detected!("avx512dq")
        {
            return Avx2::detect().map(Self);
        }
        None
    }

    /// The smaller instruction sets.
    pub fn avx2(self) -> Avx2 {
        self.0
    }
}
