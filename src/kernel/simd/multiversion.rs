//! Compiles kernels for several instruction sets, and runs the best one that the processor has.
//!
//! On x86-64 these are AVX-512, AVX2, and SSE2, which every such processor has. SSE4.2 would take as long to compile as
//! SSE2, and is the best one of few processors. Elsewhere it is what `fearless_simd` chooses.
//!
//! Only what is inlined into a kernel is compiled for its instruction set, so the parts of kernels are inlined always. Without
//! optimization this would make five times as much code, none of it fast. There kernels are compiled for SSE2 alone, and
//! nothing is inlined. Results are the same bits.

/// Evaluates an expression with the best instruction set: `dispatch!(simd => kernel(simd, ...))`.
macro_rules! dispatch {
    ($simd:pat => $kernel:expr) => {{
        #[cfg(not(target_arch = "x86_64"))]
        {
            fearless_simd::dispatch!(fearless_simd::Level::new(), $simd => $kernel)
        }
        #[cfg(all(target_arch = "x86_64", unoptimized))]
        {
            vectorize!($crate::kernel::simd::multiversion::sse2(fearless_simd::Level::new()), $simd => $kernel)
        }
        #[cfg(all(target_arch = "x86_64", not(unoptimized)))]
        {
            let level = fearless_simd::Level::new();
            if let Some(avx512) = level.as_avx512() {
                vectorize!(avx512, $simd => $kernel)
            } else if let Some(avx2) = level.as_avx2() {
                vectorize!(avx2, $simd => $kernel)
            } else {
                vectorize!($crate::kernel::simd::multiversion::sse2(level), $simd => $kernel)
            }
        }
    }};
}

/// Evaluates an expression as a function of its own, which is compiled for one instruction set.
#[cfg(target_arch = "x86_64")]
macro_rules! vectorize {
    ($token:expr, $simd:pat => $kernel:expr) => {{
        let token = $token;
        fearless_simd::Simd::vectorize(
            token,
            #[inline(always)]
            || {
                let $simd = token;
                $kernel
            },
        )
    }};
}

/// The instruction set that all processors have.
#[cfg(target_arch = "x86_64")]
pub(in crate::kernel) fn sse2(level: fearless_simd::Level) -> fearless_simd::Sse2 {
    level.as_sse2().expect("every x86-64 processor has SSE2")
}
