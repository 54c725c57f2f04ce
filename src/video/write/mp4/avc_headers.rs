//! H.264 headers as an MP4 needs them: NAL units out of a byte stream, colour and timing written into the sequence
//! parameter set, and the decoder configuration record (ISO/IEC 14496-15, 5.3.3).

use crate::video::read::h264::unescape;

/// NAL unit types used here (ITU-T H.264, table 7-1).
pub(super) const SLICE: u8 = 1;
/// A slice of a picture that decoding can start at.
pub(super) const IDR_SLICE: u8 = 5;
/// Sequence parameter set.
pub(super) const SPS: u8 = 7;
/// Picture parameter set.
pub(super) const PPS: u8 = 8;

/// The NAL units of an Annex B byte stream, without start codes and trailing zeros.
pub(super) fn nal_units(stream: &[u8]) -> Vec<&[u8]> {
    let mut starts = Vec::new();
    let mut i = 0;
    while i + 3 <= stream.len() {
        if stream[i..i + 3] == [0, 0, 1] {
            starts.push(i);
            i += 3;
        } else {
            i += 1;
        }
    }
    let ends = starts.iter().skip(1).copied().chain([stream.len()]);
    let unit = |(&start, end): (&usize, usize)| {
        let unit = &stream[start + 3..end];
        let length = unit.iter().rposition(|&b| b != 0).map_or(0, |last| last + 1);
        &unit[..length]
    };
    starts.iter().zip(ends).map(unit).filter(|unit| !unit.is_empty()).collect()
}

/// Type of a NAL unit.
pub(super) fn kind(unit: &[u8]) -> u8 {
    unit[0] & 31
}

/// Whether a slice is the first of its picture: `first_mb_in_slice` is 0, coded as a single 1 bit.
pub(super) fn starts_picture(unit: &[u8]) -> bool {
    matches!(kind(unit), SLICE | IDR_SLICE) && unit.get(1).is_some_and(|b| b & 0x80 != 0)
}

/// Gives a sequence parameter set without video usability information one that says: BT.709 in limited range, chroma
/// sited left, fixed frame rate, pictures in output order (annex E). `None` when the set has one already or is damaged.
pub(super) fn with_usability(sps: &[u8], (rate, per): (u32, u32), references: u32) -> Option<Vec<u8>> {
    let payload = unescape(sps);
    let last = payload.iter().rposition(|&b| b != 0)?;
    // The stop bit is the last 1; the bit before it is `vui_parameters_present_flag`.
    let stop = last * 8 + 7 - payload[last].trailing_zeros() as usize;
    let mut bits = Bits { bytes: payload, length: stop };
    if stop < 40 || bits.get(stop - 1) {
        return None;
    }
    bits.length = stop - 1;
    bits.push(1, 1); // vui_parameters_present_flag
    bits.push(1, 1); // aspect_ratio_info_present_flag
    bits.push(1, 8); // square pixels
    bits.push(0, 1); // overscan_info_present_flag
    bits.push(1, 1); // video_signal_type_present_flag
    bits.push(5, 3); // video_format: unspecified
    bits.push(0, 1); // video_full_range_flag
    bits.push(1, 1); // colour_description_present_flag
    for _ in ["primaries", "transfer", "matrix"] {
        bits.push(1, 8); // BT.709
    }
    bits.push(1, 1); // chroma_loc_info_present_flag
    bits.push_exp_golomb(0); // left, top field
    bits.push_exp_golomb(0); // left, bottom field
    bits.push(1, 1); // timing_info_present_flag
    bits.push(per, 32); // num_units_in_tick
    bits.push(rate.checked_mul(2)?, 32); // time_scale: two fields a frame
    bits.push(1, 1); // fixed_frame_rate_flag
    bits.push(0, 3); // no hypothetical decoder parameters (NAL, VCL), no picture structure
    bits.push(1, 1); // bitstream_restriction_flag
    bits.push(1, 1); // motion_vectors_over_pic_boundaries_flag
    for value in [0, 0, 15, 15, 0, references] {
        // No limit on bytes and bits; longest vectors 2^15; no reordering; frames to keep.
        bits.push_exp_golomb(value);
    }
    bits.push(1, 1); // stop bit
    Some(escape(&bits.bytes[..bits.length.div_ceil(8)]))
}

/// The `avcC` record of one sequence and one picture parameter set, four-byte NAL lengths.
pub(super) fn configuration(sps: &[u8], pps: &[u8]) -> Option<Vec<u8>> {
    let &[_, profile, compatibility, level, ..] = sps else { return None };
    let mut record = vec![1, profile, compatibility, level, 0xff, 0xe1];
    for (count, set) in [(None, sps), (Some(1), pps)] {
        record.extend(count);
        record.extend(u16::try_from(set.len()).ok()?.to_be_bytes());
        record.extend_from_slice(set);
    }
    if profile == 100 {
        // 4:2:0, 8 bits of luma and chroma, no extension.
        record.extend([0xfd, 0xf8, 0xf8, 0]);
    }
    Some(record)
}

/// Bits in order, most significant first.
struct Bits {
    bytes: Vec<u8>,
    length: usize,
}

impl Bits {
    fn get(&self, i: usize) -> bool {
        self.bytes[i / 8] >> (7 - i % 8) & 1 == 1
    }

    fn push(&mut self, value: u32, count: u32) {
        for i in (0..count).rev() {
            let (byte, shift) = (self.length / 8, 7 - self.length % 8);
            self.bytes.resize(byte + 1, 0);
            let bit = (value >> i & 1) as u8;
            self.bytes[byte] = self.bytes[byte] & !(1 << shift) | bit << shift;
            self.length += 1;
        }
    }

    /// Unsigned Exp-Golomb code (9.1).
    fn push_exp_golomb(&mut self, value: u32) {
        let count = 32 - (value + 1).leading_zeros();
        self.push(0, count - 1);
        self.push(value + 1, count);
    }
}

/// Puts emulation prevention bytes in.
fn escape(payload: &[u8]) -> Vec<u8> {
    let mut out = Vec::with_capacity(payload.len() + 4);
    let mut zeros = 0;
    for &byte in payload {
        if zeros >= 2 && byte <= 3 {
            out.push(3);
            zeros = 0;
        }
        zeros = if byte == 0 { zeros + 1 } else { 0 };
        out.push(byte);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn splits_a_byte_stream() {
        let stream = [0, 0, 0, 1, 0x67, 1, 2, 0, 0, 1, 0x68, 9, 0, 0, 0, 0, 1, 0x65, 0x80];
        let units = nal_units(&stream);
        assert_eq!(units, [&[0x67, 1, 2][..], &[0x68, 9], &[0x65, 0x80]]);
        assert_eq!(units.iter().map(|u| kind(u)).collect::<Vec<_>>(), [SPS, PPS, IDR_SLICE]);
        assert!(starts_picture(units[2]) && !starts_picture(units[0]));
        assert!(nal_units(&[]).is_empty() && nal_units(&[0, 0, 1]).is_empty());
    }

    #[test]
    fn escaping_is_undone_and_hides_start_codes() {
        let payload = [1, 0, 0, 0, 0, 0, 0, 1, 0, 0, 2, 0, 0, 3, 7];
        let escaped = escape(&payload);
        assert!(escaped.windows(3).all(|w| w[..2] != [0, 0] || w[2] > 2));
        assert_eq!(unescape(&escaped), payload);
    }

    #[test]
    fn exp_golomb_codes() {
        let mut bits = Bits { bytes: Vec::new(), length: 0 };
        (0..4).for_each(|v| bits.push_exp_golomb(v));
        assert_eq!((bits.bytes, bits.length), (vec![0b1010_0110, 0b0100_0000], 12));
    }
}
