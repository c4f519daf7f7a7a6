//! How arrays lie in an extent's payload: a count, then (offset, bytes) per array, then the arrays,
//! each 16-byte aligned relative to the payload. All integers little-endian.

use bytemuck::Pod;

/// What an extent holds; the number is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[repr(u16)]
pub enum ExtentKind {
    /// Patches and seams ([`crate::model::geometry`]).
    Geometry = 1,
    /// Reflectance and exitance per patch side ([`crate::model::geometry::SideMaterial`]).
    Materials = 2,
    /// Clusters that a cluster sees ([`crate::model::visibility`]).
    Visibility = 3,
    /// Irradiance of elements ([`crate::model::light`]).
    Radiosity = 4,
    /// Links of a receiving cluster ([`crate::model::links`]).
    Links = 5,
    /// Ray structure of a cluster, or the top level over all ([`crate::model::rays`]).
    Rays = 6,
    /// What baking needs later ([`crate::model::origin::BakeCorner`]).
    Bake = 7,
    /// Which input faces a patch came from ([`crate::model::origin::PatchSource`]).
    Provenance = 8,
}

impl ExtentKind {
    /// All kinds, in the order of their numbers.
    pub const ALL: [Self; 8] = [
        Self::Geometry,
        Self::Materials,
        Self::Visibility,
        Self::Radiosity,
        Self::Links,
        Self::Rays,
        Self::Bake,
        Self::Provenance,
    ];

    /// The kind with a stored number.
    #[must_use]
    pub fn from_number(number: u16) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| *kind as u16 == number)
    }
}

const ALIGN: usize = 16;

/// A payload as views borrow from it.
#[cfg(test)]
pub(crate) fn aligned(payload: &[u8]) -> Vec<u128> {
    let mut words = vec![0u128; payload.len().div_ceil(ALIGN)];
    bytemuck::cast_slice_mut::<u128, u8>(&mut words)[..payload.len()].copy_from_slice(payload);
    words
}

/// Writes arrays into one payload.
#[derive(Default)]
pub struct ArraysBuilder {
    arrays: Vec<Vec<u8>>,
}

impl ArraysBuilder {
    /// Appends an array.
    #[must_use]
    pub fn with<T: Pod>(mut self, records: &[T]) -> Self {
        self.arrays.push(bytemuck::cast_slice(records).to_vec());
        self
    }

    /// The finished payload.
    #[must_use]
    pub fn finish(self) -> Vec<u8> {
        let bytes: Vec<usize> = self.arrays.iter().map(Vec::len).collect();
        let mut out = table(&bytes);
        for array in &self.arrays {
            out.extend_from_slice(array);
            out.extend_from_slice(padding(array.len()));
        }
        out
    }
}

/// What a payload of arrays of so many bytes begins with; each array follows with its [`padding`].
#[must_use]
pub fn table(arrays: &[usize]) -> Vec<u8> {
    let mut out = (arrays.len() as u64).to_le_bytes().to_vec();
    let mut offset = (8 + 16 * arrays.len()).next_multiple_of(ALIGN);
    for bytes in arrays {
        out.extend_from_slice(&(offset as u64).to_le_bytes());
        out.extend_from_slice(&(*bytes as u64).to_le_bytes());
        offset = (offset + bytes).next_multiple_of(ALIGN);
    }
    out.extend_from_slice(padding(out.len()));
    out
}

/// Zeros behind an array, or table, of so many bytes.
#[must_use]
pub fn padding(bytes: usize) -> &'static [u8] {
    const ZEROS: [u8; ALIGN] = [0; ALIGN];
    &ZEROS[..bytes.next_multiple_of(ALIGN) - bytes]
}

/// Reads arrays out of a payload, which must be 16-byte aligned in memory (extents are 64).
#[derive(Clone, Copy)]
pub struct Arrays<'a> {
    payload: &'a [u8],
}

impl<'a> Arrays<'a> {
    /// Over a payload.
    #[must_use]
    pub fn new(payload: &'a [u8]) -> Self {
        Self { payload }
    }

    fn word(&self, at: usize) -> Option<usize> {
        let bytes = self.payload.get(at..at + 8)?;
        usize::try_from(u64::from_le_bytes(bytes.try_into().ok()?)).ok()
    }

    /// How many arrays there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.word(0).unwrap_or(0)
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Bytes of array `index` by the table at the payload's start, whether or not the rest is there.
    #[must_use]
    pub fn bytes_of(&self, index: usize) -> Option<usize> {
        (index < self.len()).then(|| self.word(16 + 16 * index)).flatten()
    }

    /// Where array `index` lies: (offset in the payload, bytes).
    pub fn place(&self, index: usize) -> Result<(usize, usize), String> {
        if index >= self.len() {
            return Err(format!("array {index} is missing"));
        }
        let (offset, bytes) = (self.word(8 + 16 * index), self.word(16 + 16 * index));
        match (offset, bytes) {
            (Some(o), Some(b)) if o.checked_add(b).is_some_and(|end| end <= self.payload.len()) => Ok((o, b)),
            _ => Err(format!("array {index} lies outside its extent")),
        }
    }

    /// Array `index` as records of `T`; what is wrong with it otherwise.
    pub fn get<T: Pod>(&self, index: usize) -> Result<&'a [T], String> {
        let (offset, bytes) = self.place(index)?;
        bytemuck::try_cast_slice(&self.payload[offset..offset + bytes])
            .map_err(|e| format!("array {index} is not made of {}-byte records: {e}", size_of::<T>()))
    }

    /// The one record of array `index`.
    pub fn one<T: Pod>(&self, index: usize) -> Result<&'a T, String> {
        self.get::<T>(index)?.first().ok_or_else(|| format!("array {index} is empty"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_come_back_as_written_and_damage_is_an_error() {
        let payload = ArraysBuilder::default().with(&[1u32, 2, 3]).with::<u64>(&[]).with(&[7u64]).finish();
        let mut aligned = vec![0u64; payload.len() / 8];
        bytemuck::cast_slice_mut::<u64, u8>(&mut aligned).copy_from_slice(&payload);
        let bytes: &[u8] = bytemuck::cast_slice(&aligned);
        let arrays = Arrays::new(bytes);
        assert_eq!(arrays.len(), 3);
        assert_eq!(arrays.get::<u32>(0).unwrap(), &[1, 2, 3]);
        assert!(arrays.get::<u64>(1).unwrap().is_empty());
        assert_eq!(*arrays.one::<u64>(2).unwrap(), 7);
        assert!(arrays.get::<u64>(3).is_err());
        assert!(arrays.get::<u64>(0).is_err(), "12 bytes are no u64s");
        assert!(Arrays::new(&bytes[..64]).get::<u64>(2).is_err(), "cut off");
    }
}
