// Speaks RS232 with an EPOS by the library of the sailing robot Avalon: serial_epos1 PORT. Prints error code and value.
#include <stdio.h>

#include "com.h"

static int fd;

static void ask(uint16_t index, uint8_t subindex, uint8_t node) {
    uint32_t value = 0, error = epos_readobject(fd, index, subindex, node, &value);
    printf("%d read %04x:%d %08x %08x\n", node, index, subindex, error, value);
}

static void tell(uint16_t index, uint8_t subindex, uint8_t node, uint32_t value) {
    printf("%d write %04x:%d %08x\n", node, index, subindex, epos_writeobject(fd, index, subindex, node, value));
}

int main(int count, char **arguments) {
    fd = epos_open(arguments[1]);
    if (fd < 0) return 1;
    for (int node = 1; node <= 4; node++) {
        ask(0x1018, 4, node);
        ask(0x1000, 0, node);
        ask(0x3333, 0, node);
        tell(0x6065, 0, node, 123456);
        ask(0x6065, 0, node);
        tell(0x6041, 0, node, 0);
        tell(0x6040, 0, node, 0x06);
        tell(0x6040, 0, node, 0x0f);
        printf("%d start %08x\n", node, epos_sendnmtservice(fd, node, EPOS_NMT_CMD_STARTREMOTENODE));
    }
    ask(0x1018, 4, 9);
    uint8_t data[8] = {5};
    printf("0 frame %08x\n", epos_sendcanframe(fd, 0x77f, 1, data));
    return 0;
}
