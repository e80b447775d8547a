//! The stand-in under the real libfreenect, driven by a C program; skipped where libfreenect or a C compiler is missing.

mod depth;
mod devices;
mod support;
