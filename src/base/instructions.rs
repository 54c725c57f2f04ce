//! Which instructions of the processor are used, chosen once for all kernels and the matrix product.
//!
//! A kernel is a function marked `#[apply(kernel)]`, which is compiled once for every set. The best set that the machine
//! has is used, unless another one is asked for, to measure or to test: by `--instructions`, or by [`VARIABLE`]. The portable
//! set has what every processor of the architecture has: on 64-bit ARM that is NEON.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicU8, Ordering};

use super::error::{Error, Kind, Result};
use super::options::nearest;

/// The environment variable that asks for a set by name.
pub const VARIABLE: &str = "ENLIVEN_INSTRUCTIONS";

/// A set of instructions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum InstructionSet {
    /// What every processor of the architecture has.
    Portable = 1,
    /// AVX2 with fused multiply-add.
    Avx2,
    /// AVX-512: F, BW, VL and DQ.
    Avx512,
}

/// The set in use; 0 until it is chosen.
static CHOSEN: AtomicU8 = AtomicU8::new(0);

impl InstructionSet {
    /// All sets, the best first.
    pub const ALL: [Self; 3] = [Self::Avx512, Self::Avx2, Self::Portable];

    /// The set that all kernels use.
    #[inline]
    pub fn chosen() -> Self {
        match CHOSEN.load(Ordering::Relaxed) {
            3 => Self::Avx512,
            2 => Self::Avx2,
            1 => Self::Portable,
            _ => first_choice(),
        }
    }

    /// Uses this set from now on, in all threads.
    ///
    /// # Errors
    /// When the machine does not have it.
    pub fn choose(self) -> Result<()> {
        self.check("--instructions")?;
        CHOSEN.store(self as u8, Ordering::Relaxed);
        Ok(())
    }

    /// Its name, as [`VARIABLE`] and `--instructions` have it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Portable => "portable",
            Self::Avx2 => "avx2",
            Self::Avx512 => "avx512",
        }
    }

    /// The sets that this machine has, the best first.
    pub fn available() -> impl Iterator<Item = Self> {
        Self::ALL.into_iter().filter(|set| set.is_available())
    }

    #[cfg(target_arch = "x86_64")]
    fn is_available(self) -> bool {
        use std::arch::is_x86_feature_detected as has;
        let avx2 = has!("avx2") && has!("fma");
        match self {
            Self::Portable => true,
            Self::Avx2 => avx2,
            Self::Avx512 => avx2 && has!("avx512f") && has!("avx512bw") && has!("avx512vl") && has!("avx512dq"),
        }
    }

    #[cfg(not(target_arch = "x86_64"))]
    fn is_available(self) -> bool {
        self == Self::Portable
    }

    fn check(self, asker: &str) -> Result<()> {
        if self.is_available() {
            return Ok(());
        }
        let there: Vec<&str> = Self::available().map(Self::name).collect();
        Err(Error::new(Kind::Usage, asker, format!("this machine does not have {}", self.name()))
            .allowed(there.join(", ")))
    }
}

impl std::str::FromStr for InstructionSet {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        Self::ALL.into_iter().find(|set| set.name() == name).ok_or_else(|| {
            let names = Self::ALL.map(Self::name);
            let meant = nearest(name, &names).map_or(String::new(), |name| format!("; did you mean {name:?}?"));
            format!("there is no instruction set {name:?} (allowed: {}){meant}", names.join(", "))
        })
    }
}

/// The set that [`VARIABLE`] asks for, else the best.
///
/// # Errors
/// A name that is none, or of a set that the machine does not have.
pub fn wanted() -> Result<InstructionSet> {
    let best = InstructionSet::available().next().unwrap_or(InstructionSet::Portable);
    let Some(name) = std::env::var_os(VARIABLE).filter(|name| !name.is_empty()) else { return Ok(best) };
    let set = name.to_string_lossy().parse::<InstructionSet>();
    let set = set.map_err(|problem| Error::new(Kind::Usage, VARIABLE, problem))?;
    set.check(VARIABLE).map(|()| set)
}

/// The programs ask for [`wanted`] before all else and tell its error; whoever calls the library without asking is told
/// here, since what was measured with another set than the one asked for would be wrong.
#[cold]
#[allow(clippy::panic)]
fn first_choice() -> InstructionSet {
    let set = wanted().unwrap_or_else(|error| panic!("{error}"));
    // Whoever chose meanwhile has the last word.
    let _ = CHOSEN.compare_exchange(0, set as u8, Ordering::Relaxed, Ordering::Relaxed);
    InstructionSet::chosen()
}

/// The version of the program with the set in use and the others that the machine has, for `--version`.
pub fn version() -> &'static str {
    static TEXT: OnceLock<String> = OnceLock::new();
    TEXT.get_or_init(|| {
        let used = InstructionSet::chosen();
        let others: Vec<&str> =
            InstructionSet::available().filter(|&set| set != used).map(InstructionSet::name).collect();
        let also = if others.is_empty() { String::new() } else { format!("; also: {}", others.join(", ")) };
        format!("{} (instructions: {}{also})", env!("CARGO_PKG_VERSION"), used.name())
    })
}

/// Compiles a function for every [`InstructionSet`] and calls the version for the one in use: `#[apply(kernel)]` above it.
/// Its parameters are plain names, of a type each; it may have constants as parameters too, and one type before them.
macro_rules! kernel {
    (
        $(#[$attribute:meta])*
        $visible:vis fn $name:ident $(<$(const $constant:ident: $sort:ty),+>)? (
            $($argument:ident: $kind:ty),* $(,)?
        ) $(-> $result:ty)? $body:block
    ) => {
        $crate::base::instructions::kernel! {
            @versions [$(#[$attribute])*] [$visible] $name [$($(const $constant: $sort),+)?] [$($($constant),+)?]
            ($($argument: $kind),*) [$(-> $result)?] $body
        }
    };
    (
        $(#[$attribute:meta])*
        $visible:vis fn $name:ident <$generic:ident: $bound:ident $(, const $constant:ident: $sort:ty)*> (
            $($argument:ident: $kind:ty),* $(,)?
        ) $(-> $result:ty)? $body:block
    ) => {
        $crate::base::instructions::kernel! {
            @versions [$(#[$attribute])*] [$visible] $name
            [$generic: $bound $(, const $constant: $sort)*] [$generic $(, $constant)*]
            ($($argument: $kind),*) [$(-> $result)?] $body
        }
    };
    (
        @versions [$($attribute:tt)*] [$visible:vis] $name:ident [$($generics:tt)*] [$($names:tt)*]
        ($($argument:ident: $kind:ty),*) [$($result:tt)*] $body:block
    ) => {
        $($attribute)*
        $visible fn $name<$($generics)*>($($argument: $kind),*) $($result)* {
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512dq,avx2,fma")]
            $($attribute)*
            fn avx512<$($generics)*>($($argument: $kind),*) $($result)* $body

            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx2,fma")]
            $($attribute)*
            fn avx2<$($generics)*>($($argument: $kind),*) $($result)* $body

            #[inline(always)]
            $($attribute)*
            fn portable<$($generics)*>($($argument: $kind),*) $($result)* $body

            match $crate::base::instructions::InstructionSet::chosen() {
                // SAFETY: a set is chosen only where the machine has all of its instructions.
                #[cfg(target_arch = "x86_64")]
                $crate::base::instructions::InstructionSet::Avx512 => unsafe { avx512::<$($names)*>($($argument),*) },
                // SAFETY: as above.
                #[cfg(target_arch = "x86_64")]
                $crate::base::instructions::InstructionSet::Avx2 => unsafe { avx2::<$($names)*>($($argument),*) },
                _ => portable::<$($names)*>($($argument),*),
            }
        }
    };
}
pub(crate) use kernel;

#[cfg(test)]
mod tests {
    use macro_rules_attribute::apply;

    use super::*;

    #[apply(kernel)]
    fn dot<const N: usize>(a: &[f32; N], b: &[f32; N]) -> f32 {
        a.iter().zip(b).fold(0.0, |sum, (a, b)| a.mul_add(*b, sum))
    }

    #[test]
    fn sets_are_known_by_name() {
        for set in InstructionSet::ALL {
            assert_eq!(set.name().parse(), Ok(set));
        }
        let error = "avx521".parse::<InstructionSet>().unwrap_err();
        assert!(error.contains("avx512, avx2, portable") && error.contains("did you mean \"avx512\"?"), "{error}");
        assert_eq!(InstructionSet::available().last(), Some(InstructionSet::Portable));
        assert!(version().starts_with(env!("CARGO_PKG_VERSION")) && version().contains("portable"));
    }

    /// The tests of kernels against what they are defined to be, again with every set but the best.
    #[test]
    fn kernels_are_right_on_every_set() {
        let tests =
            ["base::matmul", "flow::tv_l1", "descriptor::", "patch::distance", "assign::dual_bound", "video::yuv"];
        for set in InstructionSet::available().skip(1) {
            let mut child = std::process::Command::new(std::env::current_exe().unwrap());
            let done = child.env(VARIABLE, set.name()).args(tests).output().unwrap();
            let said = String::from_utf8_lossy(&done.stdout);
            assert!(done.status.success() && !said.contains("running 0 tests"), "{}: {said}", set.name());
        }
    }

    #[test]
    fn a_kernel_is_one_function() {
        assert_eq!(dot(&[1.0, 2.0, 3.0], &[4.0, 5.0, 6.0]), 32.0);
    }
}
