//! How fields lie in a datagram: one table from which the encoder, the C header and the description follow.

/// A field's type on the wire: little-endian, aligned to its size.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wire {
    /// Bytes.
    U8,
    /// Unsigned, two bytes.
    U16,
    /// Unsigned, four bytes.
    U32,
    /// Unsigned, eight bytes.
    U64,
    /// Signed, eight bytes.
    I64,
    /// IEEE 754, eight bytes.
    F64,
}

impl Wire {
    /// Bytes of one.
    pub const fn size(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::U16 => 2,
            Self::U32 => 4,
            Self::U64 | Self::I64 | Self::F64 => 8,
        }
    }

    /// Its name in C.
    pub const fn c_name(self) -> &'static str {
        match self {
            Self::U8 => "uint8_t",
            Self::U16 => "uint16_t",
            Self::U32 => "uint32_t",
            Self::U64 => "uint64_t",
            Self::I64 => "int64_t",
            Self::F64 => "double",
        }
    }

    /// Its letter in Python's `struct`.
    pub const fn python_letter(self) -> char {
        match self {
            Self::U8 => 'B',
            Self::U16 => 'H',
            Self::U32 => 'I',
            Self::U64 => 'Q',
            Self::I64 => 'q',
            Self::F64 => 'd',
        }
    }
}

/// A field of the datagram.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Field {
    /// Its name, in C too.
    pub name: &'static str,
    /// Its type.
    pub wire: Wire,
    /// How many of them; 1: it is no array.
    pub count: usize,
    /// The first byte.
    pub offset: usize,
    /// Unit and meaning.
    pub meaning: &'static str,
}

impl Field {
    /// Bytes of all.
    pub const fn size(&self) -> usize {
        self.wire.size() * self.count
    }
}

/// A value that knows its type on the wire.
pub(super) trait OnWire: Sized {
    const WIRE: Wire;
    const COUNT: usize;
    fn put(&self, bytes: &mut Vec<u8>);
    /// From the front of the bytes, which it takes; `None`: too few.
    fn take(bytes: &mut &[u8]) -> Option<Self>;
}

macro_rules! on_wire {
    ($($number:ty => $wire:ident),* $(,)?) => {$(
        impl OnWire for $number {
            const WIRE: Wire = Wire::$wire;
            const COUNT: usize = 1;
            fn put(&self, bytes: &mut Vec<u8>) {
                bytes.extend_from_slice(&self.to_le_bytes());
            }
            fn take(bytes: &mut &[u8]) -> Option<Self> {
                let (front, rest) = bytes.split_first_chunk()?;
                *bytes = rest;
                Some(Self::from_le_bytes(*front))
            }
        }
    )*};
}
on_wire!(u8 => U8, u16 => U16, u32 => U32, u64 => U64, i64 => I64, f64 => F64);

impl<T: OnWire + Copy + Default, const N: usize> OnWire for [T; N] {
    const WIRE: Wire = T::WIRE;
    const COUNT: usize = N;
    fn put(&self, bytes: &mut Vec<u8>) {
        self.iter().for_each(|value| value.put(bytes));
    }
    fn take(bytes: &mut &[u8]) -> Option<Self> {
        let mut values = [T::default(); N];
        for value in &mut values {
            *value = T::take(bytes)?;
        }
        Some(values)
    }
}
