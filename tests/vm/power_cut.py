#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What is on a disk after its power was cut: an image as it was, and what was written to it since.

usage: power_cut.py WRITES IMAGE honest|lying SEED

WRITES is a log of qemu's blklogwrites (the kernel's dm-log-writes.rst has the format), IMAGE is the disk as it
was when the log began; it is changed in place.

honest  what was written before the last flush that was answered is there; of what came after, each block of
        4 KB is there or not, as a drive with a cache of its own leaves it
lying   the drive answered its flushes and had not yet written: the last 1 to 256 writes are missing, flushed
        or not, as if it had died a moment earlier; 1 or 2 as likely as 128 to 256
"""
import os
import random
import struct
import sys

MAGIC = 0x6A736677736872
FLUSH, FUA, DISCARD = 1, 2, 4
# What a drive writes at once; a write may be torn between two of these.
BLOCK_BYTES = 4096
# Writes that a lying drive may hold back: 1 MB of single blocks, the smallest of real drives' caches.
MOST_HELD_BACK = 256


def read_writes(log):
    """(offset, bytes or None, flags) of each write; the last one may be cut off, and is left out."""
    magic, version, _, sector = struct.unpack("<QQQI", log.read(28))
    if magic != MAGIC or version != 1:
        sys.exit("power_cut: no log of writes")
    size = os.fstat(log.fileno()).st_size
    at = sector
    while at + sector <= size:
        log.seek(at)
        # Not the count in the head, which is as of the last flush.
        first, count, flags, data_bytes = struct.unpack("<QQQQ", log.read(32))
        at += sector
        if (first, count, flags, data_bytes) == (0, 0, 0, 0):
            break
        place = at
        if not flags & DISCARD:
            at += count * sector
        if at > size:
            break
        yield first * sector, place, 0 if flags & DISCARD else count * sector, flags


def main():
    log_name, image_name, kind, seed = sys.argv[1:]
    chance = random.Random(int(seed))
    with open(log_name, "rb") as log, open(image_name, "r+b") as image:
        writes = list(read_writes(log))
        flushes = [i for i, write in enumerate(writes) if write[3] & FLUSH]
        kept = flushes[-1] + 1 if flushes else 0
        if kind == "lying":
            kept = max(0, len(writes) - int(MOST_HELD_BACK ** chance.random()))
        lost = 0
        for i, (offset, place, length, flags) in enumerate(writes):
            log.seek(place)
            for begin in range(0, length, BLOCK_BYTES):
                data = log.read(min(BLOCK_BYTES, length - begin))
                there = i < kept or (kind == "honest" and (flags & FUA or chance.random() < 0.5))
                if there:
                    image.seek(offset + begin)
                    image.write(data)
                else:
                    lost += 1
        flushed = sum(1 for i in flushes if i >= kept)
        print(f"{len(writes)} writes, {len(flushes)} flushes; lost {lost} blocks and {flushed} flushes")


main()
