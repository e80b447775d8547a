//! What others read of the table: a C header and a description. Both lie in the repository; a test holds them against the
//! table, and `cargo test --test main -- --ignored regenerate` writes them anew.

use super::datagram::{MAGIC, OTHER_REASON, REASONS, SIZE, Telemetry, VERSION};
use super::layout::{Field, Wire};

/// The header, relative to the root of the repository.
pub const HEADER: &str = "examples/tumbled_telemetry.h";
/// The description, relative to the root of the repository.
pub const DESCRIPTION: &str = "docs/telemetry.md";

/// The format of the datagram for Python's `struct`.
pub fn python_format() -> String {
    let part = |field: &Field| match (field.wire, field.count) {
        (Wire::U8, count) if count > 1 => format!("{count}s"),
        (wire, 1) => wire.python_letter().to_string(),
        (wire, count) => format!("{count}{}", wire.python_letter()),
    };
    core::iter::once("<".to_owned()).chain(Telemetry::FIELDS.iter().map(part)).collect()
}

fn array(field: &Field) -> String {
    if field.count == 1 { String::new() } else { format!("[{}]", field.count) }
}

/// The C header.
pub fn header() -> String {
    let mut fields = String::new();
    for field in Telemetry::FIELDS {
        let name = format!("{}{};", field.name, array(field));
        let meaning = field.meaning.replace('`', "");
        fields += &format!("    {:<8} {name:<25} /* {meaning} */\n", field.wire.c_name());
    }
    let mut reasons = String::new();
    for (bit, (name, meaning)) in REASONS.iter().enumerate() {
        let name = format!("TUMBLED_REASON_{}", name.to_uppercase());
        reasons += &format!("#define {name:<28} (UINT32_C(1) << {bit}) /* {meaning} */\n");
    }
    let other = OTHER_REASON.trailing_zeros();
    let [m, a, g, i] = MAGIC.map(char::from);
    format!(
        "\
/* UDP telemetry of tumbled, layout {VERSION}. Generated from the daemon's table of fields: do not edit.
 *
 * One datagram is one struct of {SIZE} bytes, little-endian, without gaps. docs/telemetry.md describes it, and
 * telemetry_client.c reads it. What is not known is NaN.
 */
#ifndef TUMBLED_TELEMETRY_H
#define TUMBLED_TELEMETRY_H

#include <assert.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#define TUMBLED_TELEMETRY_MAGIC   \"{m}{a}{g}{i}\"
#define TUMBLED_TELEMETRY_VERSION {VERSION}
#define TUMBLED_TELEMETRY_SIZE    {SIZE}

enum tumbled_origin {{ TUMBLED_LIVE = 1, TUMBLED_REPLAY = 2, TUMBLED_SIMULATED = 3 }};
enum tumbled_mode {{
    TUMBLED_NO_TARGET = 0, TUMBLED_ACQUIRING = 1, TUMBLED_TRACKING = 2, TUMBLED_PREDICTED = 3, TUMBLED_LOST = 4
}};
enum tumbled_validity {{ TUMBLED_INVALID = 0, TUMBLED_DEGRADED = 1, TUMBLED_OK = 2 }};
enum tumbled_kind {{ TUMBLED_EPOCH = 1, TUMBLED_PREDICTION = 2 }};

{reasons}#define {:<28} (UINT32_C(1) << {other}) /* one that this layout has no bit for */

struct tumbled_telemetry {{
{fields}}};

static_assert(sizeof(struct tumbled_telemetry) == TUMBLED_TELEMETRY_SIZE, \"the compiler leaves gaps\");
static_assert(offsetof(struct tumbled_telemetry, crc32) == TUMBLED_TELEMETRY_SIZE - 4, \"the compiler leaves gaps\");

/* CRC-32 (IEEE 802.3): polynomial 0xEDB88320 reflected, begun and ended with all ones. */
static inline uint32_t tumbled_crc32(const unsigned char *bytes, size_t count)
{{
    uint32_t crc = UINT32_C(0xFFFFFFFF);
    for (size_t i = 0; i < count; i++) {{
        crc ^= bytes[i];
        for (int bit = 0; bit < 8; bit++)
            crc = (crc >> 1) ^ (UINT32_C(0xEDB88320) & (UINT32_C(0) - (crc & 1)));
    }}
    return ~crc;
}}

/* Reads a datagram on a little-endian machine. Returns NULL, or what is wrong with it. It does not look at the origin:
 * take nothing but TUMBLED_LIVE for a measurement. */
static inline const char *tumbled_telemetry_read(const unsigned char *bytes, size_t count,
                                                 struct tumbled_telemetry *out)
{{
    const uint16_t one = 1;
    unsigned char low;
    memcpy(&low, &one, 1);
    if (low != 1)
        return \"this machine is big-endian\";
    if (count < 8 || memcmp(bytes, TUMBLED_TELEMETRY_MAGIC, 4) != 0)
        return \"not telemetry of tumbled\";
    if (bytes[4] != (TUMBLED_TELEMETRY_VERSION & 0xFF) || bytes[5] != (TUMBLED_TELEMETRY_VERSION >> 8))
        return \"another layout: use the client that came with the daemon\";
    if (count != TUMBLED_TELEMETRY_SIZE)
        return \"another length\";
    memcpy(out, bytes, sizeof *out);
    if (out->size != TUMBLED_TELEMETRY_SIZE)
        return \"another length\";
    if (out->crc32 != tumbled_crc32(bytes, TUMBLED_TELEMETRY_SIZE - 4))
        return \"damaged: the checksum does not fit\";
    return NULL;
}}

#endif
",
        "TUMBLED_REASON_OTHER"
    )
}

/// The description.
pub fn description() -> String {
    let mut fields = String::new();
    for field in Telemetry::FIELDS {
        let wire = format!("{}{}", field.wire.c_name(), array(field));
        fields += &format!("| {} | `{}` | `{wire}` | {} |\n", field.offset, field.name, field.meaning);
    }
    let mut reasons = String::new();
    for (bit, (name, meaning)) in REASONS.iter().enumerate() {
        reasons += &format!("| {bit} | `{name}` | {meaning} |\n");
    }
    let format = python_format();
    let other = OTHER_REASON.trailing_zeros();
    format!(
        "\
# UDP telemetry

One datagram is one state of the target: a struct of {SIZE} bytes, little-endian, every field aligned to its size, so that a C
struct lies on it without gaps. This page and [`tumbled_telemetry.h`](../examples/tumbled_telemetry.h) are generated from
the daemon's own table (`cargo test --test main -- --ignored regenerate`).

| byte | field | type | unit, frame and meaning |
|---|---|---|---|
{fields}
Bits of `reasons`:

| bit | name | meaning |
|---|---|---|
{reasons}| {other} | | one that this layout has no bit for |

For Python's `struct`: `{format}`.

`[stream] telemetry` is the address, `telemetry_kind` says which states go there: `epoch` (the default: of measurements, some
60 to 200 ms old), `predicted` (`rate_hz` times a second, predicted to the moment of sending: for who steers by it) or `both`; then a
prediction is newer than the epoch that comes after it.

## What a receiver does

1. Checks length, magic and version, then the checksum; drops what does not fit. Another version is another layout.
2. Looks at `origin`. Anything but 1 is a rehearsal: the daemon sends it only with `--allow-nonlive`, and the clients here
   refuse it without theirs.
3. Compares `session` with the last one: another one is a daemon that was started anew; its `sequence` begins at 0.
4. Follows `sequence`: a step of more than one is a loss; a step back is a datagram that came late, and is dropped. It wraps
   from 4294967295 to 0.
5. Looks at `validity` and `mode` before it uses anything. Unknown numbers are NaN, and NaN compares false with everything.
6. Computes the age: its own clock less `unix_ns`. Both clocks have to be disciplined (NTP, PTP) for that to mean anything.
   UDP says nothing of a sender that is gone: a receiver has its own deadline.

The daemon never waits for the network: what the kernel does not take at once is counted, and its sequence number is missing.

## Clients

```sh
cc -O2 -o telemetry_client examples/telemetry_client.c && ./telemetry_client --port 7118
python3 examples/telemetry_client.py --port 7118
```

Both print a line for every datagram (pose, age), say what was lost on stderr, and take `--allow-nonlive`, `--bind ADDRESS`
(default 127.0.0.1) and `--count N` (stop after N good datagrams). They end with 3 at the first datagram that is not live,
unless that is allowed.
"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn python_reads_the_same_number_of_bytes() {
        // Four bytes, H, H, four B, I, sixteen bytes, q, q, Q, 29 doubles, I, I.
        assert_eq!(python_format(), "<4sHHBBBBI16sqqQ3d4d3d3d3dd12dII");
    }

    #[test]
    fn every_field_is_in_the_header_and_in_the_description() {
        let (header, description) = (header(), description());
        for field in Telemetry::FIELDS {
            assert!(header.contains(&format!(" {}{};", field.name, array(field))), "{}", field.name);
            assert!(description.contains(&format!("| {} | `{}` |", field.offset, field.name)), "{}", field.name);
        }
    }
}
