//! Pictures out: PNG for display, Radiance HDR for values.

use std::io::{self, Cursor, Write};

use image::codecs::hdr::HdrEncoder;

/// Writes an sRGB PNG; `tone_map` names how the pixels came from light.
pub fn write_png(pixels: &[u8], (width, height): (u32, u32), tone_map: &str, out: &mut dyn Write) -> io::Result<()> {
    let mut encoder = png::Encoder::new(out, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_source_srgb(png::SrgbRenderingIntent::RelativeColorimetric);
    encoder.add_text_chunk("Tone map".to_owned(), tone_map.to_owned()).map_err(io_error)?;
    let mut writer = encoder.write_header().map_err(io_error)?;
    writer.write_image_data(pixels).map_err(io_error)?;
    writer.finish().map_err(io_error)
}

/// What the output said, as it said it: whether a pipe broke is for the caller.
fn io_error(error: png::EncodingError) -> io::Error {
    match error {
        png::EncodingError::IoError(error) => error,
        other => io::Error::other(other),
    }
}

/// Writes a Radiance picture of radiance, W/(m2 sr); `lines` go into its header, like `VIEW=...`.
pub fn write_hdr(
    pixels: &[[f32; 3]],
    (width, height): (u32, u32),
    lines: &[String],
    out: &mut dyn Write,
) -> io::Result<()> {
    let mut encoded = Cursor::new(Vec::new());
    let pixels: Vec<image::Rgb<f32>> = pixels.iter().map(|p| image::Rgb(*p)).collect();
    HdrEncoder::new(&mut encoded).encode(&pixels, width as usize, height as usize).map_err(io::Error::other)?;
    let encoded = encoded.into_inner();
    // The library's own header ends with the first empty line; ours says what the values are.
    let body = encoded.windows(2).position(|w| w == b"\n\n").map_or(0, |at| at + 2);
    writeln!(out, "#?RADIANCE")?;
    for line in lines {
        writeln!(out, "{line}")?;
    }
    write!(out, "FORMAT=32-bit_rle_rgbe\n\n")?;
    out.write_all(&encoded[body..])
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::ImageDecoder;

    #[test]
    fn a_png_reads_back_and_names_its_tone_map() {
        let pixels: Vec<u8> = (0..6 * 4 * 3).map(|i| i as u8).collect();
        let mut out = Vec::new();
        write_png(&pixels, (6, 4), "Reinhard", &mut out).unwrap();
        let back = image::load_from_memory(&out).unwrap().to_rgb8();
        assert_eq!((back.dimensions(), back.as_raw()), ((6, 4), &pixels));
        let mut reader = png::Decoder::new(Cursor::new(&out)).read_info().unwrap();
        reader.next_frame(&mut [0; 72]).unwrap();
        let text = &reader.info().uncompressed_latin1_text[0];
        assert_eq!((text.keyword.as_str(), text.text.as_str()), ("Tone map", "Reinhard"));
    }

    #[test]
    fn a_radiance_picture_reads_back_within_its_precision() {
        let pixels: Vec<[f32; 3]> = (0..40).map(|i| [i as f32, 0.5, 1e-3 * i as f32]).collect();
        let mut out = Vec::new();
        write_hdr(&pixels, (10, 4), &["VIEW=-vtv -vh 60".to_owned()], &mut out).unwrap();
        assert!(out.starts_with(b"#?RADIANCE\nVIEW=-vtv -vh 60\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 10\n"));
        let decoder = image::codecs::hdr::HdrDecoder::new(Cursor::new(&out)).unwrap();
        assert_eq!(decoder.dimensions(), (10, 4));
        let back = image::load_from_memory(&out).unwrap().to_rgb32f();
        for (pixel, original) in back.pixels().zip(&pixels) {
            let brightest = original.iter().copied().fold(0.0, f32::max);
            for i in 0..3 {
                assert!((pixel.0[i] - original[i]).abs() <= brightest / 100.0, "{pixel:?} {original:?}");
            }
        }
    }
}
