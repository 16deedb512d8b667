// Speaks with an EPOS4 by the driver of EPFL's rocket team: serial_epos4 PORT. What it needs of its controller stands here.
#include <fcntl.h>
#include <stdint.h>
#include <stdio.h>
#include <sys/select.h>
#include <termios.h>
#include <unistd.h>

typedef int *SemaphoreHandle_t;
typedef int StaticSemaphore_t;
#define pdTRUE 1
#define pdMS_TO_TICKS(milliseconds) (milliseconds)
static int fd, given, huart6;
void maxon_comm_receive(uint8_t byte);

static SemaphoreHandle_t xSemaphoreCreateBinaryStatic(StaticSemaphore_t *semaphore) { return semaphore; }
static void xSemaphoreGive(SemaphoreHandle_t semaphore) { given = 1; }
static int xSemaphoreTake(SemaphoreHandle_t semaphore, int milliseconds) {
    uint8_t byte;
    for (given = 0; !given;) {
        struct timeval left = {milliseconds / 1000, milliseconds % 1000 * 1000};
        fd_set ready;
        FD_ZERO(&ready);
        FD_SET(fd, &ready);
        if (select(fd + 1, &ready, NULL, NULL, &left) != 1 || read(fd, &byte, 1) != 1) return 0;
        maxon_comm_receive(byte);
    }
    return 1;
}
static void HAL_UART_Transmit(int *port, uint8_t *data, uint16_t length, int milliseconds) { write(fd, data, length); }
static void PP_setLed(int red, int green, int blue) {}

#include "maxon_comm.c"

static void ask(uint16_t index, uint8_t subindex) {
    uint8_t data[4] = {0};
    uint32_t error = Read_object(index, subindex, data);
    printf("1 read %04x:%d %08x %08x\n", index, subindex, error,
           data[0] | data[1] << 8 | data[2] << 16 | (uint32_t)data[3] << 24);
}

static void tell(uint16_t index, uint8_t subindex, uint32_t value) {
    uint8_t data[4] = {value, value >> 8, value >> 16, value >> 24};
    printf("1 write %04x:%d %08x\n", index, subindex, Write_object(index, subindex, data));
}

int main(int count, char **arguments) {
    struct termios line;
    fd = open(arguments[1], O_RDWR | O_NOCTTY);
    if (fd < 0 || tcgetattr(fd, &line)) return 1;
    cfmakeraw(&line);
    tcsetattr(fd, TCSANOW, &line);
    maxon_comm_init();
    ask(0x1018, 4);
    ask(0x1000, 0);
    tell(0x6065, 0, 123456);
    ask(0x6065, 0);
    tell(0x6065, 0, 0x90);
    ask(0x6065, 0);
    tell(0x6065, 0, 0x90900290);
    ask(0x6065, 0);
    return 0;
}
