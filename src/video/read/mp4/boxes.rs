//! Boxes of ISO/IEC 14496-12 (and QuickTime atoms, which they come from).

/// Big-endian reader over a box's payload; past the end it gives `None`.
#[derive(Debug, Clone, Copy)]
pub struct Bytes<'a>(pub &'a [u8]);

impl<'a> Bytes<'a> {
    /// The next `n` bytes.
    pub fn take(&mut self, n: usize) -> Option<&'a [u8]> {
        let (head, rest) = self.0.split_at_checked(n)?;
        self.0 = rest;
        Some(head)
    }

    /// Skips `n` bytes.
    pub fn skip(&mut self, n: usize) -> Option<()> {
        self.take(n).map(drop)
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.take(N)?.try_into().ok()
    }

    /// Unsigned, 8 bits.
    pub fn u8(&mut self) -> Option<u8> {
        self.array().map(u8::from_be_bytes)
    }

    /// Unsigned, 16 bits.
    pub fn u16(&mut self) -> Option<u16> {
        self.array().map(u16::from_be_bytes)
    }

    /// Unsigned, 32 bits.
    pub fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_be_bytes)
    }

    /// Signed, 32 bits.
    pub fn i32(&mut self) -> Option<i32> {
        self.array().map(i32::from_be_bytes)
    }

    /// Unsigned, 64 bits.
    pub fn u64(&mut self) -> Option<u64> {
        self.array().map(u64::from_be_bytes)
    }

    /// Signed, 64 bits.
    pub fn i64(&mut self) -> Option<i64> {
        self.array().map(i64::from_be_bytes)
    }

    /// Version and flags of a full box.
    pub fn version(&mut self) -> Option<u8> {
        self.u32().map(|v| (v >> 24) as u8)
    }
}

/// Name of a box.
pub type Name = [u8; 4];

/// The boxes in `payload`, in order; a box longer than what is left ends the walk.
pub fn children(payload: &[u8]) -> impl Iterator<Item = (Name, &[u8])> {
    let mut rest = Bytes(payload);
    std::iter::from_fn(move || {
        let size = rest.u32()?;
        let name: Name = rest.array()?;
        let body = match size {
            0 => rest.0.len(),
            1 => usize::try_from(rest.u64()?.checked_sub(16)?).ok()?,
            _ => (size as usize).checked_sub(8)?,
        };
        Some((name, rest.take(body)?))
    })
}

/// The first box called `name`.
pub fn child<'a>(payload: &'a [u8], name: &Name) -> Option<&'a [u8]> {
    children(payload).find(|(n, _)| n == name).map(|(_, body)| body)
}

/// The box reached by following `path`.
pub fn find<'a>(payload: &'a [u8], path: &[&Name]) -> Option<&'a [u8]> {
    path.iter().try_fold(payload, |body, name| child(body, name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn walks_plain_long_and_open_boxes() {
        let mut data = vec![0, 0, 0, 9, b'a', b'b', b'c', b'd', 7];
        data.extend([0, 0, 0, 1, b'l', b'o', b'n', b'g', 0, 0, 0, 0, 0, 0, 0, 17, 8]);
        data.extend([0, 0, 0, 0, b'r', b'e', b's', b't', 1, 2, 3]);
        let boxes: Vec<_> = children(&data).map(|(n, b)| (n, b.to_vec())).collect();
        assert_eq!(boxes, [(*b"abcd", vec![7]), (*b"long", vec![8]), (*b"rest", vec![1, 2, 3])]);
        for cut in 0..data.len() {
            assert!(children(&data[..cut]).count() <= 3);
        }
        assert_eq!(children(&[0, 0, 0, 3, b'b', b'a', b'd', b'!']).count(), 0);
    }
}
