//! The tables of an MP4 file with one H.264 track (ISO/IEC 14496-12 and 14496-15).

/// What the tables of a track say.
#[derive(Debug)]
pub(super) struct Track<'a> {
    /// Width and height to show, in pixels.
    pub size: (u16, u16),
    /// Time units per second.
    pub timescale: u32,
    /// Length of every frame in time units.
    pub frame_duration: u32,
    /// Decoder configuration record.
    pub configuration: &'a [u8],
    /// Bytes of every frame.
    pub sizes: &'a [u32],
    /// Frames that decoding can start at, counted from 0.
    pub keyframes: &'a [u32],
    /// Frames of a chunk; the last may have fewer.
    pub frames_per_chunk: usize,
}

/// The file type box: what readers may expect.
pub(super) fn file_type() -> Vec<u8> {
    let words: [&[u8]; 6] = [b"isom", &[0, 0, 2, 0], b"isom", b"iso2", b"avc1", b"mp41"];
    container(b"ftyp", &words)
}

/// Head of the media data box for `length` bytes of frames: always the 16-byte form, so that its size is known before.
pub(super) fn media_head(length: u64) -> Vec<u8> {
    [&1u32.to_be_bytes()[..], b"mdat", &(length + 16).to_be_bytes()].concat()
}

/// The movie box, for frames that begin at byte `data` of the file. Its length does not depend on `data`.
pub(super) fn movie(track: &Track, data: u64) -> Vec<u8> {
    let duration = track.sizes.len() as u64 * u64::from(track.frame_duration);
    let media = container(
        b"mdia",
        &[
            &full(b"mdhd", 1, 0, &[&[0; 16], &be(track.timescale), &duration.to_be_bytes(), &[0x55, 0xc4, 0, 0]]),
            &full(b"hdlr", 0, 0, &[&[0; 4], b"vide", &[0; 12], b"video\0"]),
            &container(
                b"minf",
                &[
                    &full(b"vmhd", 0, 1, &[&[0; 8]]),
                    &container(b"dinf", &[&full(b"dref", 0, 0, &[&be(1), &full(b"url ", 0, 1, &[])])]),
                    &sample_tables(track, data),
                ],
            ),
        ],
    );
    let matrix = [0x10000, 0, 0, 0, 0x10000, 0, 0, 0, 0x4000_0000].map(be).concat();
    let header = full(
        b"mvhd",
        1,
        0,
        &[
            &[0; 16], // no creation and modification time: the same frames give the same bytes
            &be(track.timescale),
            &duration.to_be_bytes(),
            &be(0x10000),  // normal speed
            &[1, 0, 0, 0], // full volume
            &[0; 8],
            &matrix,
            &[0; 24],
            &be(2), // next free track
        ],
    );
    let (width, height) = (be(u32::from(track.size.0) << 16), be(u32::from(track.size.1) << 16));
    let track_header = full(
        b"tkhd",
        1,
        3, // enabled, in the movie
        &[&[0; 16], &be(1), &[0; 4], &duration.to_be_bytes(), &[0; 16], &matrix, &width, &height],
    );
    container(b"moov", &[&header, &container(b"trak", &[&track_header, &media])])
}

fn sample_tables(track: &Track, data: u64) -> Vec<u8> {
    let frames = track.sizes.len();
    let count = be(frames as u32);
    let keyframes: Vec<u8> = track.keyframes.iter().flat_map(|k| (k + 1).to_be_bytes()).collect();
    let sizes: Vec<u8> = track.sizes.iter().flat_map(|s| s.to_be_bytes()).collect();
    let mut offset = data;
    let mut offsets = Vec::new();
    for chunk in track.sizes.chunks(track.frames_per_chunk) {
        offsets.extend(offset.to_be_bytes());
        offset += chunk.iter().map(|&size| u64::from(size)).sum::<u64>();
    }
    container(
        b"stbl",
        &[
            &full(b"stsd", 0, 0, &[&be(1), &sample_entry(track)]),
            &full(b"stts", 0, 0, &[&be(1), &count, &be(track.frame_duration)]),
            &full(b"stss", 0, 0, &[&be(track.keyframes.len() as u32), &keyframes]),
            &full(b"stsc", 0, 0, &chunk_runs(frames, track.frames_per_chunk).each_ref().map(Vec::as_slice)),
            &full(b"stsz", 0, 0, &[&[0; 4], &count, &sizes]),
            &full(b"co64", 0, 0, &[&be((offsets.len() / 8) as u32), &offsets]),
        ],
    )
}

/// Runs of chunks with equally many frames: the full ones, then a shorter last one.
fn chunk_runs(frames: usize, per_chunk: usize) -> [Vec<u8>; 2] {
    let run = |first: usize, frames: usize| [first as u32, frames as u32, 1].map(be).concat();
    let (full, rest) = (frames / per_chunk, frames % per_chunk);
    let mut runs = Vec::new();
    if full > 0 {
        runs.push(run(1, per_chunk));
    }
    if rest > 0 {
        runs.push(run(full + 1, rest));
    }
    [be(runs.len() as u32).to_vec(), runs.concat()]
}

fn sample_entry(track: &Track) -> Vec<u8> {
    let (width, height) = (track.size.0.to_be_bytes(), track.size.1.to_be_bytes());
    let head = [
        &[0, 0, 0, 0, 0, 0, 0, 1][..], // data reference 1
        &[0; 16],
        &width,
        &height,
        &be(0x48_0000), // 72 dpi across
        &be(0x48_0000), // and down
        &[0; 4],
        &[0, 1], // one frame a sample
        &[0; 32],
        &[0, 24, 0xff, 0xff], // 24 bits, no colour table
    ]
    .concat();
    // BT.709 primaries, transfer and matrix; limited range.
    let colour = container(b"colr", &[b"nclx", &[0, 1, 0, 1, 0, 1, 0]]);
    let square = container(b"pasp", &[&be(1), &be(1)]);
    container(b"avc1", &[&head, &container(b"avcC", &[track.configuration]), &colour, &square])
}

fn be(value: u32) -> [u8; 4] {
    value.to_be_bytes()
}

/// A box of `parts`.
fn container(kind: &[u8; 4], parts: &[&[u8]]) -> Vec<u8> {
    let length = 8 + parts.iter().map(|p| p.len()).sum::<usize>();
    let mut out = Vec::with_capacity(length);
    out.extend(be(length as u32));
    out.extend(kind);
    parts.iter().for_each(|part| out.extend_from_slice(part));
    out
}

/// A box with a version and flags.
fn full(kind: &[u8; 4], version: u8, flags: u32, parts: &[&[u8]]) -> Vec<u8> {
    let head = be(u32::from(version) << 24 | flags);
    container(kind, &[&[&head[..]], parts].concat())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn track(sizes: &[u32]) -> Track<'_> {
        let (size, keyframes) = ((16, 16), &[0]);
        Track { size, timescale: 25, frame_duration: 1, configuration: &[1], sizes, keyframes, frames_per_chunk: 3 }
    }

    /// Walks boxes and checks that the children fill their parents.
    fn walk(bytes: &[u8], names: &mut Vec<String>) {
        let mut rest = bytes;
        while !rest.is_empty() {
            let length = u32::from_be_bytes(rest[..4].try_into().unwrap()) as usize;
            let name = String::from_utf8(rest[4..8].to_vec()).unwrap();
            if ["moov", "trak", "mdia", "minf", "stbl", "dinf"].contains(&name.as_str()) {
                walk(&rest[8..length], names);
            }
            names.push(name);
            rest = &rest[length..];
        }
    }

    #[test]
    fn boxes_nest_and_fill() {
        let mut names = Vec::new();
        walk(&[file_type(), movie(&track(&[5; 7]), 1000)].concat(), &mut names);
        for name in ["ftyp", "mvhd", "tkhd", "mdhd", "hdlr", "vmhd", "dref", "stsd", "stts", "stss", "stsc", "co64"] {
            assert_eq!(names.iter().filter(|n| *n == name).count(), 1, "{name}");
        }
    }

    #[test]
    fn chunks_cover_the_frames() {
        for (frames, runs) in [(7, vec![[1, 3, 1], [3, 1, 1]]), (6, vec![[1, 3, 1]]), (2, vec![[1, 2, 1]])] {
            let [count, table] = chunk_runs(frames, 3);
            assert_eq!(count, be(runs.len() as u32));
            assert_eq!(table, runs.concat().into_iter().flat_map(u32::to_be_bytes).collect::<Vec<_>>());
        }
        let far = movie(&track(&[5; 7]), 1 << 40);
        assert_eq!(far.len(), movie(&track(&[5; 7]), 0).len());
        assert_eq!(far[far.len() - 8..], ((1u64 << 40) + 30).to_be_bytes());
    }
}
