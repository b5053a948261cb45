#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""A bender by another hand: pymodbus, struct and zlib, nothing of ours.

Implements the handshake of drivers/README.md for the map that tests/support/bender_maps.h calls
OddMap. Prints "listening PORT"; ends when its standard input does.
"""
import asyncio
import struct
import sys
import time
import zlib

from pymodbus.datastore import (ModbusSequentialDataBlock, ModbusServerContext,
                                ModbusSlaveContext)
from pymodbus.server.async_io import ModbusTcpServer

# Input registers.
MODE, HEARTBEAT, REPLY_SEQUENCE, REPLY = 7, 9, 30, 31
ACTIVE_HEAD, ACTIVE_ROWS = 100, 200
# Holding registers.
STAGED_HEAD, STAGED_ROWS, COMMIT = 500, 600, 510
# part number, sequence, row count at +0, +1, +2; crc, low word first, at +4.
STRIDE, MAX_ROWS = 5, 25  # row: angle, rotation, unused, length low, length high
IDLE, ACCEPTED, REJECTED = 20, 7, 9


def crc_of(part, sequence, rows, registers):
    data = struct.pack(">III", part, sequence, rows)
    for row in range(rows):
        words = registers[row * STRIDE:(row + 1) * STRIDE]
        words[2] = 0
        data += struct.pack(">5H", *words)
    return zlib.crc32(data)


def row_words(angle, rotation, feed):
    low, high = struct.unpack("<HH", struct.pack("<f", feed))
    return [round(angle * 100) & 0xFFFF, round(rotation * 100), 0, low, high]


class Inputs(ModbusSequentialDataBlock):
    def getValues(self, address, count=1):
        ticks = int(time.monotonic() * 100) & 0xFFFFFFFF
        self.values[HEARTBEAT:HEARTBEAT + 2] = [ticks & 0xFFFF, ticks >> 16]
        return super().getValues(address, count)


class Holdings(ModbusSequentialDataBlock):
    def __init__(self, inputs):
        super().__init__(0, [0] * 2048)
        self.inputs = inputs

    def setValues(self, address, values):
        super().setValues(address, values)
        if address <= COMMIT < address + len(values):
            self.commit(self.values[COMMIT])

    def commit(self, asked):
        part, sequence, rows = self.values[STAGED_HEAD:STAGED_HEAD + 3]
        crc = self.values[STAGED_HEAD + 4] | self.values[STAGED_HEAD + 5] << 16
        staged = self.values[STAGED_ROWS:STAGED_ROWS + MAX_ROWS * STRIDE]
        active = self.inputs.values
        good = (2 <= rows <= MAX_ROWS and asked == sequence and active[MODE] == IDLE and
                active[ACTIVE_HEAD] == part and active[ACTIVE_HEAD + 1] != sequence and
                crc == crc_of(part, sequence, rows, staged))
        if good:
            active[ACTIVE_ROWS:ACTIVE_ROWS + rows * STRIDE] = staged[:rows * STRIDE]
            active[ACTIVE_HEAD:ACTIVE_HEAD + 6] = self.values[STAGED_HEAD:STAGED_HEAD + 6]
        active[REPLY] = ACCEPTED if good else REJECTED
        active[REPLY_SEQUENCE] = asked


async def main():
    inputs = Inputs(0, [0] * 512)
    # 100 R0 45; 50 R90 30; 20 R-30 60; 10: feeds summed, rotations reversed and summed.
    rows = [(45, 0, 100), (30, 270, 150), (60, 300, 170), (0, 300, 180)]
    words = [word for row in rows for word in row_words(*row)]
    inputs.values[ACTIVE_ROWS:ACTIVE_ROWS + len(words)] = words
    crc = crc_of(42, 3, len(rows), words)
    inputs.values[ACTIVE_HEAD:ACTIVE_HEAD + 6] = [42, 3, len(rows), 0, crc & 0xFFFF, crc >> 16]
    inputs.values[MODE] = IDLE

    slave = ModbusSlaveContext(ir=inputs, hr=Holdings(inputs), zero_mode=True)
    server = ModbusTcpServer(ModbusServerContext(slaves=slave, single=True),
                             address=("127.0.0.1", 0))
    serving = asyncio.ensure_future(server.serve_forever())
    await server.serving
    print("listening", server.server.sockets[0].getsockname()[1], flush=True)
    await asyncio.get_running_loop().run_in_executor(None, sys.stdin.read)
    serving.cancel()


asyncio.run(main())
