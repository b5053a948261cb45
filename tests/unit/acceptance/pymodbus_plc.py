#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""A bender's PLC by another hand: pymodbus, struct and zlib, and of ours only what drivers/README.md
and config/register-maps/default.toml say.

Prints "listening PORT". Commands on standard input are what somebody at the machine does: cycle, guard,
fault, idle, edit, power-cycle, stop, start; each is answered with "done". Ends with its standard input.
"""
import asyncio
import struct
import sys
import threading
import time
import zlib

from pymodbus.datastore import (ModbusSequentialDataBlock, ModbusServerContext,
                                ModbusSlaveContext)
from pymodbus.server.async_io import ModbusTcpServer

MODE, FAULT_CODE, HEARTBEAT, REPLY, REPLY_CODE, REPLY_SEQUENCE, PARTS_BENT = 0, 1, 2, 3, 4, 5, 7
ACTIVE, STAGING, COMMIT = 100, 1000, 2000
HEAD_SIZE, ROWS_AT, STRIDE, MAX_ROWS = 7, 10, 8, 40
AREA_SIZE = ROWS_AT + MAX_ROWS * STRIDE
NOT_READY, IDLE, BENDING, IN_FAULT = 0, 1, 2, 3
ACCEPTED, REJECTED = 1, 2
# The cell's orders (9 to 30) and report (3000 to 3039) are there; nobody gives orders here.
READABLE = [(0, 31), (ACTIVE, HEAD_SIZE), (ACTIVE + ROWS_AT, MAX_ROWS * STRIDE),
            (STAGING, HEAD_SIZE), (STAGING + ROWS_AT, MAX_ROWS * STRIDE), (COMMIT, 2),
            (3000, 40)]
WRITABLE = READABLE[3:]
LONGEST_MM, LARGEST_DEG = 3000, 190  # what this machine's mechanics allow


class Plc(ModbusSequentialDataBlock):
    """All holding registers, and the PLC's program: it runs once for each request."""

    def __init__(self):
        super().__init__(0, [0] * 3072)
        self.last_commit = 0
        self.runs = True
        self.begun = time.monotonic()
        self.values[MODE] = IDLE
        rows = [(100, 0, 45.5, 30), (80.25, 90, 30, 30), (60, -120, 90, 30), (55.5, 0, 0, 0)]
        self.load(42, 7, rows)

    def pair(self, at):
        return self.values[at] << 16 | self.values[at + 1]

    def set_pair(self, at, value):
        self.values[at:at + 2] = [value >> 16 & 0xFFFF, value & 0xFFFF]

    def crc(self, area):
        rows = self.values[area + 4]
        words = self.values[area + ROWS_AT:area + ROWS_AT + min(rows, MAX_ROWS) * STRIDE]
        head = struct.pack(">III", self.pair(area), self.pair(area + 2), rows)
        return zlib.crc32(head + struct.pack(f">{len(words)}H", *words))

    def load(self, part, sequence, rows):
        self.set_pair(ACTIVE, part)
        self.set_pair(ACTIVE + 2, sequence)
        self.values[ACTIVE + 4] = len(rows)
        for row, values in enumerate(rows):
            for i, value in enumerate(values):
                raw = round(value * 1000)
                self.set_pair(ACTIVE + ROWS_AT + row * STRIDE + 2 * i, raw & 0xFFFFFFFF)
        self.set_pair(ACTIVE + 5, self.crc(ACTIVE))

    # What the PLC must do on a change of the commit register.
    def reason_to_reject(self, asked):
        rows = self.values[STAGING + 4]
        if self.values[MODE] != IDLE:
            return 5
        if asked != self.pair(STAGING + 2):
            return 2
        if asked == self.pair(ACTIVE + 2):
            return 6
        if rows < 2 or rows > MAX_ROWS:
            return 3
        if self.crc(STAGING) != self.pair(STAGING + 5):
            return 1
        if self.pair(STAGING) != self.pair(ACTIVE):
            return 7
        for row in range(rows):
            at = STAGING + ROWS_AT + row * STRIDE
            length, rotation, angle = struct.unpack(
                ">iii", struct.pack(">6H", *self.values[at:at + 6]))
            if not 0 <= length <= LONGEST_MM * 1000 or abs(rotation) > 180000:
                return 4
            if not 0 <= angle <= LARGEST_DEG * 1000 or (row == rows - 1 and angle != 0):
                return 4
        return 0

    def commit(self, asked):
        code = self.reason_to_reject(asked)
        if code == 0:
            self.values[ACTIVE:ACTIVE + AREA_SIZE] = self.values[STAGING:STAGING + AREA_SIZE]
            self.set_pair(STAGING + 2, 0)
        self.values[REPLY_CODE] = code
        self.values[REPLY] = REJECTED if code else ACCEPTED
        self.set_pair(REPLY_SEQUENCE, asked)

    def scan(self):
        if not self.runs:
            return
        self.values[HEARTBEAT] = int((time.monotonic() - self.begun) * 20) & 0xFFFF
        asked = self.pair(COMMIT)
        if asked != self.last_commit:
            self.last_commit = asked
            if asked != 0:
                self.commit(asked)

    def hand(self, command):
        modes = {"cycle": BENDING, "guard": NOT_READY, "fault": IN_FAULT, "idle": IDLE}
        if command in modes:
            self.values[MODE] = modes[command]
            self.values[FAULT_CODE] = 99 if command == "fault" else 0
        elif command == "edit":  # keyed in: sequence and crc are 0
            self.values[ACTIVE + ROWS_AT + 5] ^= 4
            self.set_pair(ACTIVE + 2, 0)
            self.set_pair(ACTIVE + 5, 0)
        elif command == "power-cycle":
            self.values[STAGING:STAGING + AREA_SIZE] = [0] * AREA_SIZE
            self.values[REPLY:REPLY + 4] = [0] * 4
            self.set_pair(COMMIT, 0)
            self.last_commit = 0
        elif command in ("stop", "start"):
            self.runs = command == "start"

    # pymodbus asks these.
    def getValues(self, address, count=1):
        self.scan()
        return super().getValues(address, count)

    def setValues(self, address, values):
        super().setValues(address, values)
        self.scan()


class Unit(ModbusSlaveContext):
    def validate(self, fc_as_hex, address, count=1):
        known = WRITABLE if fc_as_hex in (6, 16) else READABLE
        return all(any(first <= register < first + size for first, size in known)
                   for register in range(address, address + count))


async def main():
    plc = Plc()
    server = ModbusTcpServer(
        ModbusServerContext(slaves=Unit(hr=plc, zero_mode=True), single=True),
        address=("127.0.0.1", int(sys.argv[1]) if len(sys.argv) > 1 else 0))
    serving = asyncio.ensure_future(server.serve_forever())
    await server.serving
    print("listening", server.server.sockets[0].getsockname()[1], flush=True)
    loop = asyncio.get_running_loop()
    over = loop.create_future()

    def obey(command):
        plc.hand(command)
        print("done", flush=True)

    def listen():
        for line in sys.stdin:
            loop.call_soon_threadsafe(obey, line.strip())
        loop.call_soon_threadsafe(over.set_result, None)

    threading.Thread(target=listen, daemon=True).start()
    await over
    serving.cancel()


asyncio.run(main())
