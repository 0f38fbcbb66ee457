"""LZF, with which PCD files are compressed."""

LONGEST = 264  # bytes that a token of 2 or 3 bytes can repeat


def lzf_decompressed(packed: bytes | memoryview, size: int) -> bytes:
    """The `size` bytes that were packed. Raises ValueError for what is not LZF, or of another size."""
    if size > LONGEST * len(packed):
        raise ValueError(f"{len(packed)} compressed bytes cannot hold {size}")
    data, out = bytes(packed), bytearray()
    at, end = 0, len(data)
    try:
        while at < end and len(out) <= size:
            token = data[at]
            at += 1
            if token < 32:
                # A run of token + 1 bytes as they are.
                out += data[at : at + token + 1]
                at += token + 1
                continue
            length = token >> 5
            if length == 7:
                length += data[at]
                at += 1
            length += 2
            start = len(out) - ((token & 31) << 8) - data[at] - 1
            at += 1
            if start < 0:
                raise ValueError("it repeats bytes before its beginning")
            run = out[start : start + length]
            # What is repeated may run into what it makes.
            out += (run * (length // len(run) + 1))[:length] if len(run) < length else run
    except IndexError as error:
        raise ValueError("its compressed bytes are cut") from error
    if at != end or len(out) != size:
        raise ValueError(f"it unpacks to {len(out)} bytes and not {size}")
    return bytes(out)
