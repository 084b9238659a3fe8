//! Memory for large arrays in large pages.
//!
//! Rays, texture look-ups and light samples read hierarchies, meshes and tables of hundreds of megabytes at random places. With pages of
//! 4 kB nearly every one of them also misses the processor's table of pages. Linux gives pages of 2 MB to those who ask.

use std::alloc::{GlobalAlloc, Layout, System};

/// The system's allocator, which asks for large pages where a block fills one.
pub struct LargePages;

/// Bytes of a large page, and of the smallest block that is put into some.
const PAGE: usize = 2 << 20;

/// The layout that the system is asked for: large blocks begin where a page does.
fn placed(layout: Layout) -> Layout {
    if layout.size() < PAGE { layout } else { layout.align_to(PAGE).unwrap_or(layout) }
}

#[allow(unsafe_code, reason = "an allocator is unsafe by contract")]
// SAFETY: every block comes from `System` with the layout that `placed` makes of the caller's, and goes back with the same.
unsafe impl GlobalAlloc for LargePages {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller's layout has a size above 0, and `placed` keeps the size.
        let block = unsafe { System.alloc(placed(layout)) };
        #[cfg(target_os = "linux")]
        if layout.size() >= PAGE && !block.is_null() {
            // SAFETY: the whole pages lie within the block, which begins at a page; the advice changes no content. Where it is refused,
            // pages stay small.
            unsafe { libc::madvise(block.cast(), layout.size() / PAGE * PAGE, libc::MADV_HUGEPAGE) };
        }
        block
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        if layout.size() < PAGE {
            // SAFETY: the caller's promises.
            return unsafe { System.alloc_zeroed(layout) };
        }
        // SAFETY: the caller's promises.
        let block = unsafe { self.alloc(layout) };
        if !block.is_null() {
            // SAFETY: the block has that size and belongs to nobody else.
            unsafe { block.write_bytes(0, layout.size()) };
        }
        block
    }

    unsafe fn dealloc(&self, block: *mut u8, layout: Layout) {
        // SAFETY: `alloc` had the block from `System` with this layout.
        unsafe { System.dealloc(block, placed(layout)) };
    }

    unsafe fn realloc(&self, block: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        if layout.size().max(size) < PAGE {
            // SAFETY: small blocks have the caller's layout.
            return unsafe { System.realloc(block, layout, size) };
        }
        // SAFETY: the caller promises that the size, rounded up to the alignment, does not overflow.
        let wanted = unsafe { Layout::from_size_align_unchecked(size, layout.align()) };
        // SAFETY: the size is above 0 by the caller's promise.
        let new = unsafe { self.alloc(wanted) };
        if !new.is_null() {
            // SAFETY: both blocks have that many bytes and do not overlap; the old one is the caller's, who gives it up.
            unsafe {
                block.copy_to_nonoverlapping(new, layout.size().min(size));
                self.dealloc(block, layout);
            }
        }
        new
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Blocks of both kinds are aligned, zeroed where that is asked for, keep what they hold when they grow and shrink across the bound
    /// between the kinds, and large ones begin at a page.
    #[test]
    #[allow(unsafe_code, reason = "an allocator is called")]
    fn blocks_keep_what_they_hold() {
        let sizes = [16, PAGE - 1, PAGE, PAGE + 17, 3 * PAGE, PAGE - 5, 100];
        let layout = |size: usize| Layout::from_size_align(size, 16).unwrap();
        // SAFETY: every block is used within its size, and given back with the layout that it was last asked for with.
        unsafe {
            let mut block = LargePages.alloc_zeroed(layout(sizes[0]));
            assert!((0..sizes[0]).all(|i| *block.add(i) == 0));
            block.write_bytes(7, sizes[0]);
            for pair in sizes.windows(2) {
                block = LargePages.realloc(block, layout(pair[0]), pair[1]);
                assert!(!block.is_null() && block.addr() % 16 == 0);
                assert!(pair[1] < PAGE || block.addr() % PAGE == 0);
                assert!((0..pair[0].min(pair[1])).all(|i| *block.add(i) == 7), "{pair:?}");
                block.write_bytes(7, pair[1]);
            }
            LargePages.dealloc(block, layout(sizes[sizes.len() - 1]));
            let zeroed = LargePages.alloc_zeroed(layout(PAGE));
            assert!((0..PAGE).all(|i| *zeroed.add(i) == 0));
            LargePages.dealloc(zeroed, layout(PAGE));
        }
    }
}
